"""Agreement with a stated truth: what no law forbids, a wrong width or factor say, shows against a reference only."""

import numpy as np

from gonio.checks.certificate import UNDECIDED, Property, verdict_of
from gonio.checks.direction_search import climb, pair, pair_angles, precision, values
from gonio.checks.model.reciprocity import STARTS, relative_difference, rounding_floor, where_of
from gonio.checks.table.pairs import Pairs
from gonio.checks.table.reciprocity import FEWEST, ROUNDING, THETA_MAX
from gonio.checks.table.significance import LEVEL, decided_by_uncertainty, judged_by_level, tested
from gonio.data.flags import Flag
from gonio.data.layouts import spherical_angles
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError


def model_agreement(brdf: AbstractBRDF, reference: AbstractBRDF, tolerance: float) -> Property:
    """The largest relative difference between f and a reference's that a search of the closed hemisphere finds.

    Raises GonioError where the two have different numbers of channels, neither of them one.
    """
    angles = np.concatenate([pair_angles(reference), pair_angles(brdf)])
    truth = values(reference, *pair(angles))
    _same_channels(values(brdf, *pair(angles[:1])).shape[-1], truth.shape[-1])
    finite = np.isfinite(truth).all(axis=-1)
    floor = rounding_floor(float(np.max(np.abs(truth[finite]), initial=0.0)))

    def differences(at):
        with np.errstate(all="ignore"):
            return relative_difference(values(brdf, *pair(at)), values(reference, *pair(at)), floor)

    found = differences(angles)
    undefined = ~np.isfinite(found).all(axis=-1)
    worst = np.where(undefined, -1.0, np.nan_to_num(found).max(axis=-1))
    best, reached = climb(lambda at: differences(at).max(axis=-1), angles[np.argsort(worst)[::-1][:STARTS]], rounds=8)
    k = int(np.nanargmax(reached)) if np.isfinite(reached).any() else 0
    residual, bound = float(reached[k]), 64 * precision()
    verdict = verdict_of(residual, bound, tolerance)
    if undefined.any() and verdict == "pass":
        verdict = UNDECIDED
    channel = int(np.argmax(np.nan_to_num(differences(best[k : k + 1])[0]))) if found.shape[-1] > 1 else None
    detail = (
        f"The largest 2|a−b|/(|a|+|b|) of f and the reference's is {residual:.2g}, searched over {len(angles):,} pairs"
        " and refined from the worst."
    )
    facts = {"pairs": len(angles), "pairs_without_a_value": int(undefined.sum())}
    return Property("agreement", verdict, residual, bound, tolerance, where_of(best[k], channel), detail, facts)


def table_agreement(table: Table, reference: AbstractBRDF, tolerance: float, level: float = LEVEL) -> Property:
    """The median relative difference between the readings below 70° and a reference's values, channel by channel.

    The channel that differs most decides. Where uncertainties are stored a family of tests does, at `level`, as for
    reciprocity. Raises GonioError as `model_agreement` does.
    """
    block = table.samples(200_000, THETA_MAX)
    f = np.where(block.flag == Flag.VALID, block.f, np.nan).astype(float)
    if len(f) < FEWEST:
        detail = f"Only {len(f)} readings below 70° can be compared; at least {FEWEST} are needed."
        return Property("agreement", UNDECIDED, None, None, tolerance, detail=detail)
    truth = values(reference, block.wi, block.wo)
    _same_channels(f.shape[-1], truth.shape[-1])
    difference = np.where(np.isfinite(f), relative_difference(np.nan_to_num(f), truth), np.nan)
    medians = np.nanmedian(difference, axis=0)
    channel = int(np.nanargmax(medians))
    residual, bound = float(medians[channel]), ROUNDING
    angles = np.stack([a for w in (block.wi, block.wo) for a in spherical_angles(*w)], -1)
    facts = {"readings": len(f), "median_by_channel": medians.tolist(), "largest": float(np.nanmax(difference))}
    pairs = Pairs(f, np.broadcast_to(truth, f.shape), np.asarray(block.u_f, float), np.zeros(f.shape), angles, len(f))
    if decided_by_uncertainty(pairs):
        found = tested(pairs, np.ones(len(f)), level)
        how, what = "readings", "The table's readings and the reference's values"
        return judged_by_level("agreement", found, how, len(f), tolerance, level, what, facts | {"median": residual})
    k = int(np.nanargmax(difference[:, channel]))
    detail = (
        f"The median of 2|a−b|/(|a|+|b|) of {len(f):,} readings below 70° and the reference's values is {residual:.2%}"
        f" (±{bound:.2%}) in the channel that differs most; the largest is {np.nanmax(difference):.2g}."
    )
    where = where_of(angles[k], channel if f.shape[-1] > 1 else None)
    return Property(
        "agreement", verdict_of(residual, bound, tolerance), residual, bound, tolerance, where, detail, facts
    )


def _same_channels(mine: int, reference: int) -> None:
    if mine != reference and 1 not in (mine, reference):
        raise GonioError(f"there are {mine} channels, and the reference has {reference}; compare equal ones, or grey")
