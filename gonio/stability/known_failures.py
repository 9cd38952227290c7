"""Why a silent failure that is known is left: method, model, where (in setting, column or precision), reason."""

from gonio.stability.outcome import Cell

EDGE = "on the very edge of the lobe, where the bracket is the rounding of its own terms and f a power of it near 0"

INFINITE = "the slope by w is infinite at w = 1, and a number stands for it"

KNOWN: tuple[tuple[str, str, str, str], ...] = (
    ("gradient", "chandrasekhar", "w=1", INFINITE),
    ("gradient", "lafortune", "n=0", EDGE),
    ("value", "lafortune", "n=0", EDGE),
    ("value", "phong", "n=0)", "at 90° from the mirror direction, where f jumps to 0 and the cosine is rounding"),
    ("gradient", "phong", "n=0", "at 90° from the mirror direction, where f jumps to 0 and the cosine is rounding"),
    ("gradient", "abg", "g=0", "at the mirror direction itself, where |β − β₀|^g jumps from 0 to 1 at g = 0"),
    ("sampler", "sgd", "alpha=1e-05", "lobe 3e-7 wide across at 89°, directions in single precision 6e-8 apart"),
    ("sampler", "abg", "b=1e-12", "|β − β₀| is the rounding of the directions there, and b far below it"),
    ("gradient", "he_torrance", "sigma=20", "orders of waves that cancel leave √g = 900 roundings, 1e-13 of f"),
    ("gradient", "kelemen", "alpha=0.0001", "a tabulated albedo's slope by alpha: its error over a width of 1e-4"),
    ("value", "abg", "b=1e-12", "|β − β₀| is the rounding of the directions there, and b far below it"),
    ("gradient", "abg", "b=1e-12", "|β − β₀| is the rounding of the directions there, and b far below it"),
)


def reason_of(cell: Cell) -> str:
    """The reason that is known for a cell's failure, or nothing."""
    where = f"{cell.row} {cell.column} {cell.precision}"
    return next((why for m, n, at, why in KNOWN if m == cell.method and n == cell.model and at in where), "")
