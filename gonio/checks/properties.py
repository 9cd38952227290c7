"""The properties that a certificate lists, in its order: a new one is a line here and the functions that it names."""

from typing import NamedTuple


class PropertySpec(NamedTuple):
    """How one property is checked and how its verdict counts.

    The checks are named, ``folder.module:function``, and imported when they run: listing the properties loads no JAX.
    None: there is no such check.
    """

    model: str | None
    """Check of a model, ``(ModelEvidence, tolerance) -> Property``."""
    table: str | None
    """Check of a table, ``(TableEvidence, tolerance) -> Property``; None where a table holds nothing of the kind."""
    model_tolerance: float
    table_tolerance: float
    unit: str
    """What the residual is, for the command line and pages."""
    counts: str = "strict"
    """"always": in every overall verdict; "strict": in a strict one; "never": what no law asks for."""
    needs_reference: bool = False
    """Checked only where a truth is stated."""


DIFFERENCE = "relative difference"

PROPERTIES = {
    "reciprocity": PropertySpec(
        "model.reciprocity:model_reciprocity",
        "table.equal_readings:table_reciprocity",
        1e-9,
        0.05,
        DIFFERENCE,
        "always",
    ),
    "energy": PropertySpec(
        "model.energy:model_energy", "table.energy:table_energy", 1e-6, 0.01, "albedo above 1", "always"
    ),
    "realisability": PropertySpec(
        None, "table.realisability:table_realisability", 1e-9, 0.02, "negative part of m00", "always"
    ),
    "positivity": PropertySpec(
        "model.positivity:model_positivity", "table.positivity:table_positivity", 1e-9, 0.01, "negative part"
    ),
    "symmetry": PropertySpec(
        "model.isotropy:model_symmetry", "table.equal_readings:table_symmetry", 1e-9, 0.05, DIFFERENCE
    ),
    "isotropy": PropertySpec(
        "model.isotropy:model_isotropy", "table.equal_readings:table_isotropy", 1e-6, 0.05, DIFFERENCE, "never"
    ),
    "pole": PropertySpec("model.edges:model_pole", "table.equal_readings:table_pole", 1e-3, 0.05, DIFFERENCE),
    "horizon": PropertySpec(
        "model.edges:model_horizon", "table.horizon:table_horizon", 1e-3, 0.5, "share of the flux, or e-folds"
    ),
    "agreement": PropertySpec(
        "model.agreement:model_agreement", "table.agreement:table_agreement", 1e-6, 0.05, DIFFERENCE, "always", True
    ),
}
