"""Random expressions to all renderers: is the printed error that of the file, and does another search end nearer?

    python tests/benchmarks/reports/random_exports.py [NUMBER [SEED [STARTS]]] [TARGET ...]

Each file is read back (see written_scenes.py) and its rms and largest difference of albedo computed anew. With STARTS
above 0 each of a renderer's forms is fitted from so many random starts too, for the rms alone, by SciPy. Prints what
differs, what was refused, and at the end counts; the exit status is 1 where a printed error was none of the file's.
"""

import collections
import contextlib
import pathlib
import sys
import tempfile
import time

import jax
import numpy as np
from scipy.optimize import least_squares

jax.config.update("jax_enable_x64", True)
sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[up]) for up in (0, 2)]
from written_scenes import READ, F  # noqa: E402

import gonio  # noqa: E402
from gonio.exports.comparison import Comparison, comparison  # noqa: E402
from gonio.exports.forms import Appearance, appearance_of  # noqa: E402
from gonio.exports.nearest import FINE, JUDGED, ROUGH  # noqa: E402
from gonio.exports.pairs import LOWEST  # noqa: E402
from gonio.exports.search import Search, least_width  # noqa: E402
from gonio.exports.targets import TARGETS  # noqa: E402

GRID = 16, 64, 16
"""Of the errors computed anew: another than that of the printed ones."""
RMS, ALBEDO = (0.02, 2e-5), (0.03, 3e-4)
"""(relative, absolute) by which they may differ from the printed ones."""
FIRST, LAST = 25, 60
"""Evaluations of each random start, and of the best of them."""


class Expressions:
    """Random surfaces as a user may write them: paints, metals, coats, sheets, interfaces."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def even(self, low: float, high: float) -> float:
        """A number."""
        return round(float(self.rng.uniform(low, high)), 3)

    def log(self, low: float, high: float) -> float:
        """A number even in its logarithm."""
        return round(float(np.exp(self.rng.uniform(np.log(low), np.log(high)))), 4)

    def colour(self, low: float, high: float) -> str:
        """Three numbers."""
        return "[" + ", ".join(str(self.even(low, high)) for _ in range(3)) + "]"

    def share(self, high: float) -> str:
        """One number or three."""
        return self.colour(0.02, high) if self.rng.random() < 0.6 else str(self.even(0.02, high))

    def tint(self) -> str:
        """A factor, or none."""
        return ["", f"{self.even(0.05, 0.6)} * ", f"{self.colour(0.05, 0.6)} * "][self.rng.integers(3)]

    def diffuse(self) -> str:
        """A diffuser."""
        rho, rough = self.share(0.7), self.even(0, 1)
        kinds = f"lambert(rho={rho})", f"eon(rho={rho}, r={rough})", f"burley_diffuse(rho={rho}, roughness={rough})"
        return [kinds[0], *kinds][self.rng.integers(4)]

    def lobe(self, brushed: bool) -> str:
        """A lobe with a Fresnel factor or without."""
        across = f"alpha_x={self.log(0.05, 0.5)}, alpha_y={self.log(0.05, 0.5)}"
        widths = across if brushed else f"alpha={self.log(0.02, 0.7)}"
        metal = f", eta={self.colour(0.2, 2)}, k={self.colour(1, 4)}"
        index = ["", f", eta={self.even(1.2, 2)}", f", f0={self.even(0.03, 0.9)}", metal][self.rng.integers(4)]
        round_one = f"phong(n={self.log(5, 300)})", f"gtr({widths}, gamma={self.even(1.5, 3)}{index})"
        brushed_one = f"ashikhmin_shirley(n_u={self.log(5, 200)}, n_v={self.log(5, 200)}, f0={self.even(0.03, 0.5)})"
        kinds = [f"ggx({widths}{index})", f"beckmann({widths}{index})", f"ggx({widths}, smith='separable'{index})"]
        kinds += [f"ward({widths})", *([brushed_one] if brushed else round_one)]
        return kinds[self.rng.integers(len(kinds))]

    def sheet(self) -> str:
        """A surface that light passes."""
        narrow, wide = self.log(0.05, 0.4), self.log(0.05, 0.4)
        kinds = (
            f"thin_sheet(rho={self.share(0.4)}, tau={self.share(0.5)})",
            f"0.5 * {self.diffuse()} + lambert_transmission(tau={self.share(0.4)})",
            f"0.8 * transmitted(base=beckmann(alpha={narrow})) + 0.1 * ggx(alpha={wide})",
            f"rough_slab(alpha={narrow}, alpha_behind={wide}, eta={self.even(1.3, 1.8)}, clear={self.even(0.5, 0.98)})",
            f"rough_dielectric(alpha={narrow}, eta={self.even(1.2, 2.2)})",
            f"rough_dielectric(alpha={narrow}, eta={self.even(1.2, 2.2)}, distribution='beckmann')",
        )
        return kinds[self.rng.integers(len(kinds))]

    def surface(self) -> str:
        """Any of them."""
        brushed, kind, index = bool(self.rng.random() < 0.25), self.rng.integers(9), self.even(1.2, 1.8)
        if kind < 3:
            return f"{self.diffuse()} + {self.tint()}{self.lobe(brushed)}"
        if kind == 3:
            return f"{self.diffuse()} + {self.tint()}{self.lobe(brushed)} + {self.tint()}{self.lobe(brushed)}"
        if kind == 4:
            return f"{self.tint()}{self.lobe(brushed)}"
        if kind == 5:
            return f"coat(base={self.diffuse()}, eta={index})"
        if kind < 8:
            return self.sheet()
        if self.rng.random() < 0.5:
            base, metallic = self.colour(0.05, 0.9), self.even(0, 1)
            return f"principled(base_color={base}, roughness={self.even(0.1, 0.9)}, metallic={metallic})"
        return f"coat(base={self.diffuse()} + {self.lobe(False)}, eta={index}, alpha={self.log(0.02, 0.3)})"


def errors(sought: Appearance, f: F) -> tuple[float, float]:
    """(relative rms, largest difference of albedo) of a file."""
    front, off, size, albedo = sought.pairs(*GRID), 0.0, 0.0, 0.0
    for side in (front, front.through()) if sought.transmits else (front,):
        wanted = np.asarray(sought.f(side.wi, side.wo))
        made = np.broadcast_to(f(side), (len(wanted), 3))
        off += float(np.sum(side.weight[:, None] * (made - wanted) ** 2))
        size += float(np.sum(side.weight[:, None] * np.broadcast_to(wanted, made.shape) ** 2))
        albedo = max(albedo, float(np.abs(side.albedo(made - wanted)[side.cosines >= LOWEST]).max(initial=0.0)))
    return float(np.sqrt(off / size)), albedo


def least_rms(sought: Appearance, target: str, starts: int) -> float:
    """The least rms that SciPy finds for any form of a renderer, without light made at grazing angles."""
    rough, fine, judged = (comparison(sought, grid) for grid in (ROUGH, FINE, JUDGED))
    rng, least = np.random.default_rng(1), np.inf
    for form in TARGETS[target].forms(sought):
        search = Search(form, sought.colours, least_width(sought, rough))
        if not search.size:
            continue
        low, high = search.low, search.high

        def residuals(x: np.ndarray, on: Comparison, form=form, search=search) -> np.ndarray:
            f = on.values(form, search.values(x))
            made = 10 * np.sqrt(on.sides[0].share)[:, None] * on._made(f)
            return np.concatenate([on.weight * (f - on.wanted), made]).ravel()

        def ended(x: np.ndarray, on: Comparison, steps: int, low=low, high=high, residuals=residuals):
            inside = np.clip(x, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
            return least_squares(residuals, inside, bounds=(low, high), x_scale=high - low, max_nfev=steps, args=(on,))

        begun = (low + (high - low) * rng.uniform(0.02, 0.98, search.size) for _ in range(starts))
        best = ended(min((ended(x, rough, FIRST) for x in begun), key=lambda end: end.cost).x, fine, LAST)
        least = min(least, judged.relative_rms(judged.values(form, search.values(best.x))))
    return least


def _same(a: float, b: float, within: tuple[float, float]) -> bool:
    return abs(a - b) <= within[0] * b + within[1]


def main() -> int:
    """Runs it; see above."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    number, seed, starts = (numbers + [10, 1, 0][len(numbers) :])[:3]
    targets = [word for word in sys.argv[1:] if not word.isdigit()] or list(READ)
    count, made, gained = collections.Counter[str](), Expressions(seed), []
    for _ in range(number):
        expression = made.surface()
        with contextlib.suppress(gonio.GonioError):
            sought = appearance_of(gonio.material(expression))
            print(expression, flush=True)
            for target in targets:
                result, gain = _one(expression, sought, target, starts)
                count[result] += 1
                gained += [gain] if gain is not None else []
    print(", ".join(f"{name} {n}" for name, n in count.items()))
    if gained:
        usual, most = np.median(gained), max(gained)
        print(f"random starts ended lower by {usual:.2f} points of rms in the median, by {most:.2f} at most")
    return int(count["DIFFERS"] > 0)


def _one(expression: str, sought: Appearance, target: str, starts: int) -> tuple[str, float | None]:
    """(what came of it, points of rms by which random starts ended lower)."""
    read, suffix = READ[target]
    with tempfile.TemporaryDirectory() as folder:
        path, began = pathlib.Path(folder, f"x{suffix}"), time.process_time()
        try:
            printed = gonio.convert(expression, path, to=target)
        except gonio.GonioError as refused:
            print(f"  {target:10s} refused: {refused}")
            return "refused", None
        seconds = time.process_time() - began
        rms, albedo = errors(sought, read(path))
    right = _same(rms, printed.relative_rms, RMS) and _same(albedo, printed.albedo_difference, ALBEDO)
    gain = None
    if starts and not printed.exact:
        gain = 100 * (printed.relative_rms - least_rms(sought, target, starts))
    print(
        f"  {target:10s} {seconds:4.1f} s  rms {100 * printed.relative_rms:8.4f} % albedo "
        f"{100 * printed.albedo_difference:7.3f}  of the file {100 * rms:8.4f} {100 * albedo:7.3f}"
        f"{'' if right else ' DIFFERS'}{'' if gain is None else f'  random starts {gain:+.2f}'}  {printed.form}",
        flush=True,
    )
    return "right" if right else "DIFFERS", gain


if __name__ == "__main__":
    raise SystemExit(main())
