"""Text for terminals that know few characters: the field's symbols by their names, the rest by its nearest letters."""

import codecs
import re
import sys
import unicodedata

NAMES = {
    "θ": "theta", "φ": "phi", "Δ": "Delta", "δ": "delta", "α": "alpha", "β": "beta", "γ": "gamma", "η": "eta",
    "λ": "lambda", "π": "pi", "ρ": "rho", "σ": "sigma", "τ": "tau", "χ": "chi", "ν": "nu", "µ": "u", "μ": "u",
    "Λ": "Lambda", "Σ": "Sigma", "ω": "omega", "∫": "integral ", "∞": "inf", "√": "sqrt", "±": "+-", "×": "x",
    "·": "*", "≤": "<=", "≥": ">=", "≪": "<<", "≈": "~", "→": "->", "−": "-", "–": "-", "—": "-", "─": "-",
    "│": "|", "…": "...", "°": " deg", "‰": " permille", "’": "'", "“": '"', "”": '"', "⁻": "^-", "ß": "ss",
    "²": "^2", "³": "^3", "⁴": "^4", "•": "*",
}  # fmt: skip
SUBSCRIPT = r"([θφ])(?=[iodh](?![a-z]))"


def in_ascii(text: str) -> str:
    """A text in ASCII: symbols by their names, letters without their marks, a question mark for the rest."""
    named = "".join(NAMES.get(c, c) for c in re.sub(SUBSCRIPT, r"\1_", text))
    return unicodedata.normalize("NFKD", named).encode("ascii", "ignore").decode() or "?"


def _replaced(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    subscript = "_" if re.match(SUBSCRIPT, error.object[error.end - 1 :]) else ""
    return in_ascii(error.object[error.start : error.end]) + subscript, error.end


def print_what_can_be_encoded() -> None:
    """Lets the streams of this process replace what their encoding lacks, in place of failing."""
    codecs.register_error("gonio", _replaced)
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="gonio")
