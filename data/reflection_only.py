"""What a method that knows reflection from the front alone says to a subject that transmits."""

from typing import TYPE_CHECKING

from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT, Hemispheres

if TYPE_CHECKING:
    from gonio.data.table import Table
    from gonio.models.brdf import AbstractBRDF


def require_reflection(subject: "Table | AbstractBRDF", name: str, method: str) -> None:
    """Raises GonioError where a table holds, or a model has, more than reflection from the front.

    Args:
        subject: the table or the model.
        name: what a user calls it.
        method: what cannot take it, as the beginning of a sentence's second half: "a plan", "a MERL file".
    """
    from gonio.data.table import Table

    if isinstance(subject, Table):
        transmits = subject.sides != FRONT
    else:
        transmits = Hemispheres.TRANSMISSION in subject.hemispheres
    if transmits:
        raise GonioError(
            f"{name} transmits, and {method} knows reflection from the front alone; measure that: "
            "gonio measure SUBJECT --hemisphere reflection -o R.h5"
        )
