"""A table or a material on the grid that a file of an optics program holds, and the error of that."""

import dataclasses

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.interpolation.coverage import require_readings_about
from gonio.data.interpolation.multilinear import as_material
from gonio.data.layouts import Layout
from gonio.data.material import Material
from gonio.data.round_trip import RoundTrip, compare, compare_cells
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError, nearest
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy
from gonio.models.geometry.sides import Hemispheres, Sides, side

COMPARED = 20_000
"""Pairs of directions at which a file is compared with its source."""
COMPARED_WITHIN = np.radians(80.0)
FINE = np.array([0.0, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0])
"""Degrees from a lobe's middle at which a file has values besides those of its even step."""


@dataclasses.dataclass(frozen=True)
class GridSource:
    """What is written: its values between all directions, and what is known of its directions."""

    source: Table | Material
    brdf: AbstractBRDF
    channels: Channels
    mix: np.ndarray
    """(channels of the source, `channels`): what each of those that are written is made of."""

    @classmethod
    def of(cls, source: Table | Material, channel: str | None = None) -> "GridSource":
        """The source, or one channel of it. Raises GonioError for a channel that it does not have."""
        names = source.channels.names
        if channel is not None and channel not in names:
            raise GonioError(f"{source.name or 'the source'} has no channel {channel!r}; {nearest(channel, names)}")
        if channel is not None and isinstance(source, Table):
            source = source.only([channel]) if len(names) > 1 else source
        brdf = as_material(source) if isinstance(source, Table) else source.brdf
        mix = np.eye(len(source.channels))
        if channel is None or isinstance(source, Table):
            return cls(source, brdf, source.channels, mix)
        return cls(source, brdf, _one(source.channels, channel), mix[:, [names.index(channel)]])

    @property
    def sides(self) -> Sides:
        """The sides of light and detector between which there is something."""
        if isinstance(self.source, Table):
            return self.source.sides
        ways = {(1, 1): Hemispheres.REFLECTION, (1, -1): Hemispheres.TRANSMISSION, (-1, 1): Hemispheres.TRANSMISSION}
        ways |= {(-1, -1): Hemispheres.BACK}
        return frozenset(sides for sides, way in ways.items() if way in self.brdf.hemispheres)

    @property
    def media_note(self) -> str:
        """What is to be said where the media on both sides differ, which no such file can state."""
        index = float(np.max(np.asarray(self.brdf.index_behind)))
        return "" if index == 1 else f"the file does not say that a medium of index {index:g} is behind the sample"

    def f(self, wi: Direction, wo: Direction) -> np.ndarray:
        """f, 1/sr, of pairs of directions (n,): (n, channels)."""
        values = evaluate_in_blocks(self.brdf, wi, wo)
        return np.broadcast_to(values, (len(values), len(self.mix))) @ self.mix

    def lobe_width(self) -> float:
        """Degrees from the mirror direction, or straight through, in which f of light at 45° falls to half; else 90."""
        offsets = np.linspace(0, 30, 121)
        theta_o, phi_o = np.radians(45.0 - offsets), np.full(offsets.size, np.pi)
        wi, wo = from_spherical(np.full(offsets.size, np.pi / 4), 0 * phi_o, np), from_spherical(theta_o, phi_o, np)
        widths = [90.0]
        for _, detector in self.sides & {(1, 1), (1, -1)}:
            f = np.mean(self.f(wi, wo._replace(z=wo.z * detector)), axis=-1)
            widths += [float(w) for w in offsets[f < np.max(f, initial=0.0) / 2][:1]]
        return min(widths)

    def light(self, step: float, step_of_azimuth: float = 15.0) -> tuple[np.ndarray, np.ndarray | None]:
        """(polar angles of the light in front, its azimuths or None where the surface is isotropic), radians.

        Args:
            step: degrees, of polar angles where the source has none of its own.
            step_of_azimuth: degrees, of its azimuths.
        """
        theta_i = np.radians(np.append(np.arange(0, 85, step), 85.0))
        phi_i = None if self.brdf.isotropic else np.radians(np.arange(0, 360, step_of_azimuth))
        if isinstance(self.source, Table) and self.source.layout.gridded:
            axes = self.source.layout.axes
            if "theta_i" in axes and (front := axes["theta_i"][axes["theta_i"] < np.pi / 2 - 1e-6]).size:
                theta_i = front
            if phi_i is not None and "phi_i" in axes:
                phi_i = axes["phi_i"]
        return theta_i, phi_i

    def on(self, layout: Layout) -> tuple[Table, str]:
        """(its values on a layout, what is to be said of them).

        A table that has this layout keeps its readings; its cells without one are interpolated. Raises GonioError for a
        table that has readings about less than half of the layout's directions.
        """
        kept = self.source if isinstance(self.source, Table) and self.source.layout == layout else None
        readable = layout.readable()
        wanted, note = readable, ""
        f = np.full((layout.size, len(self.channels)), np.nan)
        if kept is not None:
            values = kept.read_values()
            known = (values["flag"] == Flag.VALID).all(axis=1)
            f[known], wanted = values["f"][known] @ self.mix, readable & ~known
            note = f"{int(wanted.sum())} cells without a reading were interpolated" if wanted.any() else ""
        if wanted.any():
            wi, wo = layout.directions_at(np.flatnonzero(wanted))
            if kept is None:
                note = self.coverage(wi, wo)
            f[wanted] = self.f(wi, wo)
        flag = np.where(readable[:, None] & np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.BELOW_HORIZON))
        shape = (*layout.shape, len(self.channels))
        return Table(layout, f.reshape(shape), flag.reshape(shape), self.channels, name=self.source.name), note

    def coverage(self, wi: Direction, wo: Direction) -> str:
        """What is to be said of how many of these pairs (n,) a table has readings about; of a model nothing.

        Raises GonioError where it has about less than half.
        """
        return require_readings_about(self.source, wi, wo) if isinstance(self.source, Table) else ""

    def compared(self, written: Table, note: str, order: np.ndarray | None = None) -> RoundTrip:
        """A file's table, read again, against the readings, or against the model where both sides are within 80°.

        `order`: numbers of the channels in the order in which the file has them; a file may have one for all of them.
        """
        order = np.arange(len(self.channels)) if order is None else order
        plain = np.array_equal(self.mix, np.eye(len(self.mix)))
        if isinstance(self.source, Table) and plain and _same_cells(self.source.layout, written.layout):
            values, again = self.source.read_values(), written.read_values()
            values = {name: a[:, order] if a.shape[1] > 1 else a for name, a in values.items()}
            again = {name: np.broadcast_to(a, (len(a), max(a.shape[1], order.size))) for name, a in again.items()}
            return compare_cells(values, again, note)
        if isinstance(self.source, Table):
            block = self.source.samples(limit=COMPARED)
            wi, wo, valid = block.wi, block.wo, block.flag == Flag.VALID
            f = np.asarray(block.f, float)
            if not plain:
                f, valid = f @ self.mix, np.broadcast_to(valid.all(axis=1, keepdims=True), (len(f), self.mix.shape[1]))
        else:
            wi, wo = _pairs(written.sides)
            f = self.f(wi, wo)
            valid = np.isfinite(f)
        here = _on_sides(wi, wo, written.sides)
        wi, wo = (Direction(*(np.asarray(c)[here] for c in w)) for w in (wi, wo))
        read = evaluate_in_blocks(as_material(written), wi, wo)
        f, valid = (a[here][:, order] for a in (f, np.broadcast_to(valid, f.shape)))
        read, f, valid = np.broadcast_arrays(read, f, valid)
        usable = valid & (f > 0)
        if usable.any():
            error = np.abs(read[usable] / f[usable] - 1)
            spread = f"median {np.median(error):.2g}, 95 % below {np.quantile(error, 0.95):.2g} relative"
            note = "; ".join(filter(None, [spread, note]))
        return compare(f, read, valid, np.isfinite(read), note)


def _same_cells(a: Layout, b: Layout) -> bool:
    """Whether two layouts have the same cells, up to what the digits of degrees leave."""
    if a.name != b.name or a.shape != b.shape:
        return False
    return all(np.allclose(axis, b.axes[name], rtol=0, atol=1e-9) for name, axis in a.axes.items())


def _one(channels: Channels, name: str) -> Channels:
    if channels.wavelengths_nm is None:
        return Channels((name,))
    return Channels((name,), (channels.wavelengths_nm[channels.names.index(name)],))


def _pairs(sides: Sides) -> tuple[Direction, Direction]:
    """Light and detector within 80° of the normals: half of them anywhere, half about the mirror direction."""
    u = low_discrepancy(COMPARED, 4)
    theta_i, phi_i = np.arccos(1 - u[:, 0] * (1 - np.cos(COMPARED_WITHIN))), 2 * np.pi * u[:, 1]
    theta_o, phi_o = np.arccos(1 - u[:, 2] * (1 - np.cos(COMPARED_WITHIN))), 2 * np.pi * u[:, 3]
    near = np.arange(COMPARED) % 2 == 1
    off = np.radians(20.0) * u[:, 2] ** 2
    theta_o = np.where(near, np.clip(np.abs(theta_i + off * np.cos(phi_o)), 0, COMPARED_WITHIN), theta_o)
    turn = np.clip(off * np.sin(phi_o) / np.maximum(np.sin(theta_i), 0.1), -np.pi, np.pi)
    phi_o = np.where(near, phi_i + np.pi + turn, phi_o)
    ways = np.array(sorted(sides, reverse=True))[np.arange(COMPARED) // 2 % len(sides)]
    wi, wo = from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
    return wi._replace(z=wi.z * ways[:, 0]), wo._replace(z=wo.z * ways[:, 1])


def _on_sides(wi: Direction, wo: Direction, sides: Sides) -> np.ndarray:
    light, detector = side(wi.z), side(wo.z)
    return np.any([(light == a) & (detector == b) for a, b in sides], axis=0)


def about_the_middle(step: float, last: float) -> np.ndarray:
    """Angles from the middle of a lobe, radians: fine there, then even up to `last`, degrees."""
    even = np.arange(step, last + step, step)
    return np.radians(np.append(FINE[step > FINE], np.minimum(even, 180.0)))


def mirror_layout(source: GridSource, step: float, transmits: bool) -> Layout:
    """The grid about the mirror direction, or straight through, of a source: its own where it has one."""
    if isinstance(source.source, Table) and source.source.layout.name == ("straight" if transmits else "mirror"):
        return source.source.layout
    theta_i, phi_i = source.light(max(step, 5.0), max(step, 15.0))
    theta_m = about_the_middle(step, min(90 + float(np.degrees(theta_i[-1])), 180 - step))
    half = phi_i is None and (not isinstance(source.source, Table) or bool(source.source.layout.mirrored_axes))
    phi_m = np.radians(np.arange(0, 180 + step / 2 if half else 360, step))
    make = layouts.straight if transmits else layouts.mirror
    return make(theta_i, theta_m, phi_m, phi_i)
