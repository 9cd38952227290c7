"""Which structure `gonio.fit` without a model chooses for synthetic truths whose structure is known.

python selection.py [TRUTHS] [SEED]      truths a class: default 50, four classes, then as many at 30 % noise in all

Lambert and one or two GGX lobes, brushed or not, metal (F = 1) or dielectric (F₀ = 0.04), three channels; widths,
strengths, colours and the noise (0.3 to 10 %, relative, independent) drawn at random. The second lobe has 0.15 to 0.5
of the width of the first and a peak of 0.3 to 3 times as high; a brushed one is 1.5 to 3 times as wide along y. Right:
the number of lobes and which are brushed, and no number of another kind. More: more lobes, more brushed ones, or more
free numbers than the truth has. Less: fewer; a number of another kind in place of a lobe is counted beside it.
"""

import collections
import sys
import time

import jax
import numpy as np

from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from gonio.fitting.problem.readings import readings_of
from gonio.fitting.selection.automatic import shows_anisotropy
from gonio.fitting.selection.stepwise import stepwise_selection
from gonio.fitting.selection.term_spec import NO_FRESNEL, SCHLICK, Terms
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

FIVE, NINE = np.radians(np.arange(0, 86, 5.0)), np.radians(np.arange(0, 82, 9.0))
ISOTROPIC = layouts.isotropic(FIVE, FIVE, np.radians(np.arange(0, 360, 20.0)))
ROUND = layouts.spherical(NINE[::2], np.radians([0, 45, 90, 135.0]), NINE, np.radians(np.arange(0, 360, 15.0)))
CLASSES = {"one lobe": (1, False), "two lobes": (2, False), "one, brushed": (1, True), "two, brushed": (2, True)}
HIGH = 0.3


def truth(rng: np.random.Generator, lobes: int, brushed: bool) -> str:
    metal = rng.random() < 0.5
    fresnel = "" if metal else ", f0=0.04"
    colour = rng.uniform(0.4, 1.0, 3)
    first = np.exp(rng.uniform(np.log(0.15), np.log(0.5)))
    strength = rng.uniform(0.2, 0.8) if metal else rng.uniform(0.5, 1.5)
    terms = [f"lambert(rho={text(rng.uniform(0.03, 0.5, 3))})"]
    widths = [first, first * rng.uniform(0.15, 0.5)][:lobes]
    for k, width in enumerate(widths):
        scale = (
            strength * colour * (1.0 if k == 0 else (width / first) ** 2 * np.exp(rng.uniform(np.log(0.3), np.log(3))))
        )
        ratio = np.sqrt(rng.uniform(1.5, 3.0))
        shape = f"alpha_x={width / ratio:.6g}, alpha_y={width * ratio:.6g}" if brushed else f"alpha={width:.6g}"
        terms.append(f"{text(scale)} * ggx({shape}{fresnel})")
    return " + ".join(terms)


def text(values: np.ndarray) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in values) + "]"


def structure(terms: Terms) -> tuple[int, int, bool]:
    """(lobes, brushed lobes, whether there is any other number than the truths have)."""
    lobes = [t for t in terms if t.is_lobe]
    other = any(t.width_each or t.fresnel not in (NO_FRESNEL, SCHLICK) or t.model != "ggx" for t in lobes)
    other = other or terms[0].model != "lambert"
    return len(lobes), sum(t.anisotropic for t in lobes), other


def run(name: str, rng: np.random.Generator, noise: float) -> tuple[str, str, float]:
    lobes, brushed = CLASSES[name]
    layout = ROUND if brushed else ISOTROPIC
    expression = truth(rng, lobes, brushed)
    f = np.asarray(evaluate(build(expression), *layout.directions())).reshape(*layout.shape, -1)
    table = whole_table_of_values(layout, f * (1 + noise * rng.standard_normal(f.shape)))
    readings = readings_of(table)
    began = time.process_time()
    chosen = stepwise_selection(readings, "cbrt", None, shows_anisotropy(layout, readings)).chosen
    seconds = time.process_time() - began
    have, want = structure(chosen.terms), (lobes, lobes if brushed else 0)
    size = 3 + lobes * (4 + brushed)
    more = have[0] > want[0] or have[1] > want[1] or chosen.size > size
    verdict = "more" if more else "less, other" if have[2] else "right" if have[:2] == want else "less"
    fresnel = {p.fresnel for p in chosen.terms if p.is_lobe}
    if verdict == "right" and fresnel != ({NO_FRESNEL} if "f0" not in expression else {SCHLICK}):
        verdict = "right, other F"
    if verdict != "right":
        print(f"   {name}, noise {noise:.3g}: {verdict}: {chosen.expression}   truth {expression}", flush=True)
    return verdict, chosen.expression, seconds


def main(number: int, seed: int) -> None:
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(seed)
    counts, seconds = {}, []
    for name in CLASSES:
        counts[name] = collections.Counter()
        for _ in range(number):
            verdict, _, took = run(name, rng, float(np.exp(rng.uniform(np.log(0.003), np.log(0.1)))))
            counts[name][verdict] += 1
            seconds.append(took)
    counts[f"all, {HIGH:.0%}"] = collections.Counter(run(list(CLASSES)[k % 4], rng, HIGH)[0] for k in range(number))
    print(f"{'truth, noise':20} {'right':>6} {'other F':>8} {'less':>6} {'less, other':>12} {'more':>6}")
    for name, c in counts.items():
        print(
            f"{name:20} {c['right']:6d} {c['right, other F']:8d} {c['less']:6d} {c['less, other']:12d} {c['more']:6d}"
        )
    low = sum((c for name, c in counts.items() if name in CLASSES), collections.Counter())
    total = low.total()
    right = low["right"] + low["right, other F"]
    print(f"0.3 to 10 %: right {right / total:.1%} (with F {low['right'] / total:.1%}), more {low['more'] / total:.1%}")
    print(f"CPU seconds a choice: median {np.median(seconds):.2f}, largest {np.max(seconds):.2f}")


if __name__ == "__main__":
    main(*(int(a) for a in (sys.argv[1:] + ["50", "0"][len(sys.argv) - 1 :])))
