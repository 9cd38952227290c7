"""The one kind of error that is a user's to mend."""


class GonioError(ValueError):
    """Bad input, in one sentence: what came, what was expected, and what to do."""
