"""What scenes let one leave out: the cheapest model and the coarsest table of a plastic, a brushed metal and soil.

Tables are simulated without noise, 5° grids (the brushed one coarser); scenes are those that come with gonio. Bytes are
those of values and flags.
"""

import time

import jax
import numpy as np

import gonio
from gonio.data import layouts
from gonio.data.scene import load_scene, shipped_scenes
from gonio.data.table import whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

FIVE = np.radians(np.arange(0, 86, 5.0))
GRID = layouts.isotropic(FIVE, FIVE, np.radians(np.arange(0, 360, 10.0)))
ROUND = layouts.spherical(
    FIVE[::3], np.radians(np.arange(0, 360, 45.0)), FIVE[::2], np.radians(np.arange(0, 360, 15.0))
)
SURFACES = {
    "plastic": ("lambert(rho=[.05,.1,.3]) + 1.0 * ggx(alpha=.25, f0=.04)", GRID),
    "brushed": ("lambert(rho=.05) + .5 * ggx(alpha_x=.25, alpha_y=.5)", ROUND),
    "soil": ("rpv(rho0=.12, k=.8, theta=-.1, rho_c=.12)", GRID),
}


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    for name, (expression, layout) in SURFACES.items():
        f = np.asarray(evaluate(build(expression), *layout.directions())).reshape(*layout.shape, -1)
        table = whole_table_of_values(layout, f, name=name)
        for scene in shipped_scenes():
            tolerance = load_scene(scene).tolerance
            began = time.process_time()
            fit = gonio.fit(table, scene=scene, starts=0)
            row = next(a for a in fit.alternatives if a["verdict"].startswith("chosen"))
            wanted = max(
                (a for a in fit.alternatives if a["scene_error"] <= tolerance), key=lambda a: a["free"], default=row
            )
            fitted, began = time.process_time() - began, time.process_time()
            small = gonio.reduce(table, scene)
            reduced = time.process_time() - began
            before, after = (t.f.nbytes + t.flag.nbytes for t in (table, small.table))
            print(
                f"{name:8} {scene:16} tolerance {tolerance:.0%}: model {row['model']} ({row['free']} numbers of "
                f"{wanted['free']}), error {row['scene_error']:.2%}, {row['verdict']}, {fitted:.1f} CPU s",
                flush=True,
            )
            print(
                f"{'':26}table {before} bytes to {after} ({before / after:.0f} times less), error {small.error:.2%}, "
                f"{reduced:.1f} CPU s; left out {'; '.join(small.left_out)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
