"""The readings of an adaptive measurement so far, with every decision; kept in a file from round to round."""

import dataclasses
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from gonio.data import layouts
from gonio.data.files import UNFINISHED, publish, refuse_existing, temporary_beside
from gonio.data.flags import Flag
from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.writer import write_table
from gonio.data.material import Material
from gonio.data.table import Table
from gonio.instrument.instrument import Instrument
from gonio.instrument.reader import Reader
from gonio.instrument.scans import is_isotropic
from gonio.instrument.sinks import provenance_of, recipe_of
from gonio.models.errors import GonioError
from gonio.planning.shots import Shots
from gonio.planning.ways import Way, ways_of

KEY = "adaptive"
"""Of the provenance."""


@dataclasses.dataclass
class Session:
    """Readings (n, C) in directions (4, n), in their order, and the rounds that chose them.

    `about` is what was asked for; `part` the file that the rounds are kept in, or None.
    """

    material: Material
    instrument: Instrument
    seed: int
    about: dict[str, Any]
    command: str | None = None
    part: Path | None = None
    angles: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((4, 0)))
    counting: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    """Seconds that each is counted."""
    values: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    rounds: list[dict[str, Any]] = dataclasses.field(default_factory=list)

    @classmethod
    def begin(
        cls, material: Material, instrument: Instrument, seed: int, about: dict[str, Any], **kept: Any
    ) -> "Session":
        """A new session, or that of an unfinished file of the same recipe.

        `kept`: `output` (or None), `force` and `command`, as `gonio.measure` takes them.

        Raises:
            GonioError: the output exists and not `force`, or its unfinished file is of another recipe.
        """
        output, force = kept["output"], kept["force"]
        session = cls(material, instrument, seed, dict(about), kept["command"])
        session.about["recipe"] = session._recipe()
        if output is None:
            return session
        refuse_existing(output, force)
        session.part = Path(f"{os.fspath(output)}{UNFINISHED}")
        if os.path.lexists(session.part):
            session._take_up(session.part, force)
        return session

    @property
    def isotropic(self) -> bool:
        """Whether the surface is read from one azimuth of the light, as the material says."""
        return is_isotropic(self.material.brdf)

    @property
    def ways(self) -> tuple[Way, ...]:
        """Where the material sends light, of those that were asked for."""
        return ways_of(self.material.brdf, self.about.get("lit", "front"), self.about.get("hemisphere", "both"))

    @property
    def count(self) -> int:
        """Readings so far."""
        return self.angles.shape[1]

    @property
    def valid(self) -> np.ndarray:
        """Whether each reading (n,) is one in all channels."""
        return (self.values["flag"] == Flag.VALID).all(axis=1)

    def seconds(self, more: Shots | None = None) -> float:
        """Seconds of all readings, and of more: moving, settling and counting."""
        angles = self.angles if more is None else np.concatenate([self.angles, more.angles], axis=1)
        counting = self.counting if more is None else np.concatenate([self.counting, more.seconds])
        return self.instrument.pace.path_seconds(angles, counting)

    def shots(self, angles: np.ndarray) -> Shots:
        """Directions (4, m) counted as long as the instrument usually does, on a short way."""
        order = self.short_way(angles)
        return Shots(angles[:, order], np.full(order.size, self.instrument.seconds))

    def read(self, shots: Shots, **why: Any) -> None:
        """Reads, and keeps what was read and why."""
        first, usual = self.count, self.instrument.seconds
        self.angles = np.concatenate([self.angles, shots.angles], axis=1)
        self.counting = np.concatenate([self.counting, shots.seconds])
        block = self._reader().read(first, self.count)
        u_f = np.zeros(block.f.shape) if block.u_f is None else block.u_f
        for name, array in {"f": block.f, "u_f": u_f, "flag": block.flag}.items():
            array = np.asarray(array, np.uint8 if name == "flag" else np.float64)
            self.values[name] = np.concatenate([self.values[name], array]) if first else array
        if (shots.seconds != usual).any():
            why["counting_s"] = shots.seconds.tolist()
        self.rounds.append({"readings": [first, self.count], "seconds": round(self.seconds(), 3), **why})

    def short_way(self, angles: np.ndarray) -> np.ndarray:
        """The order of directions (4, m) that goes to the nearest next, from where the axes are now."""
        here = self.angles[:, -1] if self.count else np.zeros(4)
        rest, order = np.arange(angles.shape[1]), []
        while rest.size:
            nearest = int(np.argmin(self.instrument.pace.moving(here[:, None], angles[:, rest])))
            here = angles[:, rest[nearest]]
            order.append(rest[nearest])
            rest = np.delete(rest, nearest)
        return np.array(order, int)

    def save(self) -> None:
        """Keeps what there is so far, at once."""
        if self.part is not None:
            temporary = temporary_beside(self.part)
            try:
                write_table(temporary, self.table(), force=True)
                publish(temporary, self.part)
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise

    def forget(self) -> None:
        """Removes the file of the rounds."""
        if self.part is not None:
            self.part.unlink(missing_ok=True)

    def finish(self, output: str | os.PathLike[str] | None, force: bool, **more: Any) -> Table:
        """The table, with `more` in its provenance, in its file where there is one."""
        table = self.table()
        table.provenance |= more
        if output is None or self.part is None:
            return table
        write_table(output, table, force)
        self.forget()
        return open_table(output)

    def table(self) -> Table:
        """All readings, scattered."""
        reader = self._reader()
        about = provenance_of(reader, self.command)
        about[KEY] = {**self.about, "rounds": self.rounds}
        f, u_f, flag = (self.values[name] for name in ("f", "u_f", "flag"))
        source, receiver = self.instrument.solid_angles()
        return Table(reader.layout, f, flag, self.material.channels, u_f, about, source, receiver, self.material.name)

    def _reader(self) -> Reader:
        return Reader(self.material, self.instrument, layouts.scattered(*self.angles), self.seed, self.counting)

    def _recipe(self) -> str:
        """Digest of what determines the readings."""
        reader = Reader(self.material, self.instrument, layouts.scattered(*np.zeros((4, 1))), self.seed)
        content = [recipe_of(provenance_of(reader, None), self.material), self.about]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def _take_up(self, part: Path, force: bool) -> None:
        try:
            if part.is_symlink():
                raise GonioError("a link")
            table = open_table(part)
            kept = table.provenance.get(KEY, {})
        except GonioError:
            table, kept = None, {}
        if table is None or kept.get("recipe") != self.about["recipe"]:
            if force and table is not None and kept:
                return
            what = (
                "holds an unfinished measurement of another recipe" if kept else "is no unfinished adaptive measurement"
            )
            raise GonioError(f"{part} {what}; finish or remove it{', or --force to replace it' if kept else ''}")
        self.angles = np.stack([np.asarray(a) for a in table.layout.angles()])
        self.values = {name: np.array(a) for name, a in table.read_values().items()}
        self.rounds = kept["rounds"]
        each = [
            r.get("counting_s", [self.instrument.seconds] * (r["readings"][1] - r["readings"][0])) for r in self.rounds
        ]
        self.counting = np.concatenate(each)
