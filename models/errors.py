"""The one kind of error that is a user's to mend, the name that was meant, and foreign text fit to be printed."""

import difflib
import itertools
import re
from collections.abc import Iterable

LONGEST = 360
"""Characters of an error's sentence: beyond, its middle is left out."""
_UNPRINTABLE = re.compile(
    r"[\x00-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff\ufff9-\ufffb]"
)
_ESCAPES = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}


def printable(text: str, kept: str = "") -> str:
    """A text whose control characters, line breaks, marks of writing direction and lone surrogates are spelled out.

    What a stranger's file calls itself can then neither move the cursor, nor forge a line, nor reverse one. The
    escapes are JSON's, so that a JSON text stays one. `kept`: characters that stay, such as a line break.
    """

    def spelled(match: re.Match[str]) -> str:
        return match[0] if match[0] in kept else _ESCAPES.get(match[0]) or f"\\u{ord(match[0]):04x}"

    return _UNPRINTABLE.sub(spelled, text)


def one_line(text: str, longest: int = LONGEST) -> str:
    """`printable`, and of at most `longest` characters: the middle of a longer one gives way to an ellipsis."""
    return _cut(printable(_cut(text, longest)), longest)


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    ahead = longest * 2 // 3
    return f"{text[:ahead]} … {text[ahead + 3 - longest :]}"


class GonioError(ValueError):
    """Bad input, in one sentence, `one_line`: what came, what was expected, and what to do."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


MOST_NAMED = 200
"""Characters of the names that a sentence lists: of a longer list it says the beginning."""


def nearest(word: str, known: Iterable[str]) -> str:
    """`did you mean 'x'?` for the known name nearest to a wrong one, or the list of what is known."""
    names = list(known)
    close = difflib.get_close_matches(word[:MOST_NAMED], names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    lengths = itertools.accumulate(len(name) + 2 for name in names)
    count = max(1, sum(1 for length in lengths if length <= MOST_NAMED))
    more = f", and {len(names) - count} more" if len(names) > count else ""
    return f"known are {', '.join(names[:count])}{more}."
