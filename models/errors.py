"""The one kind of error that is a user's to mend, and the name that was meant."""

import difflib
from collections.abc import Iterable


class GonioError(ValueError):
    """Bad input, in one sentence: what came, what was expected, and what to do."""


MOST_NAMED = 50  # of a longer list a sentence says the beginning


def nearest(word: str, known: Iterable[str]) -> str:
    """`did you mean 'x'?` for the known name nearest to a wrong one, or the list of what is known."""
    names = list(known)
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    more = f", and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f"known are {', '.join(names[:MOST_NAMED])}{more}."
