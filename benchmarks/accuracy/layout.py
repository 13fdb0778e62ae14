"""What the layout of real receptors costs, beside as many spread evenly over the same skins.

    python benchmarks/accuracy/layout.py icub_skin --touches 20000 --targets 300 --seeds 1 2

Even receptors lie on the convex hull of the real ones, where their fields reach, each as far as
possible from the others; their fields are as wide. Errors are from the surface, in percent of a
skin's size: the mean of the skins whose shape was recovered, each weighted by its kernels, and that
of each of them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import write_csv
from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.geometry.receptors import ReceptiveFields
from selftouch_drake.robot import World
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_body, load_representation
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.scores import score_body

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import learned
from benchmarks.shared.results import ROOT, add_update_option, results


def spread_evenly(fields: ReceptiveFields) -> np.ndarray:
    """`(S, 3)` m, places for as many receptors as these fields are of."""
    hull = trimesh.convex.convex_hull(fields.p_LS).subdivide_to_size(fields.radius / 2)
    reached = cKDTree(fields.p_LS).query(hull.vertices)[0] <= fields.radius
    places = np.array(hull.vertices[reached])
    chosen = farthest_points(
        lambda place: np.linalg.norm(places - places[place], axis=1), fields.num_receptors
    )
    return places[chosen]


def row(run: RunDirectory) -> dict[str, Any]:
    """The errors of what a run recovered."""
    known = load_representation(run)
    found = score_body(run, stages.make_world(run), known, load_body(run, known))
    by_skin = found.get("surface_rms_fraction_by_skin", {})
    return {
        "parts": known.num_parts,
        "skins": len(by_skin),
        "error": round(100 * found.get("surface_rms_fraction", np.nan), 1),
        "by_skin": "; ".join(f"{skin} {error:.1%}" for skin, error in by_skin.items()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("experiment", help="such as icub_skin")
    parser.add_argument("--touches", type=int, default=20_000)
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "layout", help="the runs")
    add_update_option(parser, "layout")
    given = parser.parse_args()
    sizes = {
        "babbling": {"num_samples": given.touches},
        "representation": {"num_targets": given.targets},
        "evaluation": {"shape_metrics": []},
    }
    even = {}
    for skin in World(load_experiment(given.experiment)).skins:
        file = given.out.resolve() / f"{given.experiment}_{skin.name}.csv"
        places = spread_evenly(skin.fields).tolist()
        write_csv(file, ["x", "y", "z", "width"], [[*p, skin.fields.radius] for p in places])
        even[skin.name] = {"receptors": str(file)}
    with results("layout", update=given.update) as add:
        for seed in given.seeds:
            for layout, skins in {"real": {}, "even": even}.items():
                experiment = load_experiment(
                    given.experiment, sizes | {"seed": seed, "skins": skins}
                )
                name = f"{experiment.name}_{layout}_{seed}"
                found = {"layout": layout, "seed": seed} | row(
                    learned(given.out / name, experiment)
                )
                add(found)
                print(*found.values(), flush=True)


if __name__ == "__main__":
    main()
