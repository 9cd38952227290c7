"""Why a cell of a table has no value. Missing, negative and zero are three things."""

import enum


class Flag(enum.IntEnum):
    """State of one reading. A negative reading is VALID: it is kept as read and reported, never clipped."""

    VALID = 0
    BELOW_HORIZON = 1
    """A direction is on the horizon, or below it where a grid holds the front alone: there is nothing to read."""
    SHADOWED = 2
    """The detector stood between the source and the sample."""
    SATURATED = 3
    """The detector was at the end of its range."""
    NOT_MEASURED = 4
    """Nobody looked, or the file says that it has no value."""
    INVALID = 5
    """The value came as NaN or infinite."""


FLAG_MEANINGS = tuple(flag.name.lower() for flag in Flag)
