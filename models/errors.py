"""The one kind of error that is a user's to mend, and the name that was meant."""

import difflib


class GonioError(ValueError):
    """Bad input, in one sentence: what came, what was expected, and what to do."""


def nearest(word: str, known) -> str:
    """`; did you mean 'x'?` for the known name nearest to a wrong one, or the list of what is known."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else f"known are {', '.join(known)}."
