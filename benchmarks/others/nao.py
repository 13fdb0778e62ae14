"""Where the taxels of a real Nao are, from its own touches. Run it as a script.

    python benchmarks/others/nao.py PATH [--files rightArm_torso ...]

PATH is the folder `UserData/Robots/Nao/Dataset` of the public repository
ctu-vras/multirobot-calibration, which has no licence: it is read where it is. Each of its nine
files holds 670 to 1,075 touches, with twelve joints and the taxels that were on. The taxels of the
skin that is touched are mapped as `selftouch map` does it, and beside it by plain Isomap on the
cosines of shared touches. The filed positions, from another calibration, are the truth:

- rho: Spearman's rank correlation of distances, along the map and filed;
- rms: mm, root mean square distance from the filed positions after a fit with one scale; rigid:
  the same at the scale that makes the extents equal;
- near: share of the six nearest of each taxel in the map that are within two spacings.

The suppositions were weighed on the first three files; the others were measured once.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
import scipy.io
from scipy.spatial.distance import cdist
from scipy.stats import spearmanr
from sklearn.manifold import Isomap

from selftouch_drake.agent.shape.alignment import align
from selftouch_drake.agent.shape.receptor_map import LEAST_FELT, map_receptors

DEVELOPED = ("rightArm_torso", "leftArm_torso", "head_leftFinger")
JUDGED = (
    *("leftArm_head", "torso_leftFinger", "torso_rightFinger"),
    *("leftArm_rightFinger", "rightArm_leftFinger", "rightArm_head"),
)
# The modules of each skin: those of its first patch, then those of its second.
ARM = ([*range(16)], [19, 20, 21, 22, 23, 25, 26, 31])
MODULES = {
    "torso": ([*range(6), *range(8, 16)], [16, 17, 18, *range(24, 32)]),
    "head": ([*range(9), 12, 13, 15], [*range(16, 25), 28, 29, 31]),
    "leftArm": ARM,
    "rightArm": ARM,
}
# A module has ten taxels and two sensors of temperature.
TAXELS = (0, 1, 2, 3, 4, 5, 7, 8, 9, 11)
NUM_TAXELS = 384


def filed_positions(path: Path, skin: str) -> np.ndarray:
    """`(384, 3)` mm, NaN where there is no taxel: sums of mount, patch, module and taxel."""
    shifts = 1e3 * np.loadtxt(path / "Transformations" / f"{skin}.txt")
    first, second = MODULES[skin]
    modules, taxels = [*first, *second], shifts[3 + len(first) + len(second) :]
    positions = np.full((NUM_TAXELS, 3), np.nan)
    for number, module in enumerate(modules):
        corner = shifts[1 if number < len(first) else 2] + shifts[3 + number]
        own = taxels[len(TAXELS) * number :][: len(TAXELS)]
        positions[12 * module + np.array(TAXELS)] = corner + own
    return positions


def touches(path: Path, name: str, skin: str) -> tuple[np.ndarray, np.ndarray]:
    """`(n, 12)` rad joints, and `(n, 384)` bool taxels of one skin that were on."""
    file = scipy.io.loadmat(path / "Datasets" / f"{name}.mat", simplify_cells=True)
    joints, active = [], np.zeros((len(file[skin]), NUM_TAXELS), dtype=bool)
    for row, touch in zip(active, file[skin], strict=True):
        if "activatedUn" in touch:  # the older files have places, then the number
            on = np.atleast_2d(touch["activatedUn"]).reshape(-1, 4)[:, 3]
        else:
            on = np.atleast_1d(touch["activatedTaxels"])
        row[on.astype(int)] = True
        joints.append([touch["angles"][joint] for joint in sorted(touch["angles"])])
    return np.array(joints), active


def scores(found: np.ndarray, along: np.ndarray, true: np.ndarray) -> dict[str, float]:
    pairs, apart = np.triu_indices(len(true), 1), cdist(true, true)
    np.fill_diagonal(apart, np.inf)
    spacing = np.median(np.sort(apart, axis=1)[:, :6])
    laid = cdist(found, found)
    np.fill_diagonal(laid, np.inf)
    near = np.take_along_axis(apart, np.argsort(laid, axis=1)[:, :6], axis=1)
    rms = lambda places: float(np.sqrt(np.square(places - true).sum(axis=1).mean()))  # noqa: E731
    fitted = align(found, true)
    grown = np.linalg.norm(true - true.mean(0)) / np.linalg.norm(fitted - fitted.mean(0))
    return {
        "rho": spearmanr(along[pairs], apart[pairs])[0],
        "rms": rms(fitted),
        "rigid": rms((fitted - fitted.mean(0)) * grown + fitted.mean(0)),
        "near": float((near <= 2.0 * spacing).mean()),
    }


def isomap(active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    norm = np.linalg.norm(active, axis=0)
    cosines = active.T @ active / np.outer(norm, norm)
    distance = np.sqrt(np.maximum(2.0 - 2.0 * cosines, 0.0))
    np.fill_diagonal(distance, 0.0)
    fitted = Isomap(n_neighbors=8, n_components=3, metric="precomputed").fit(distance)
    return fitted.embedding_, fitted.dist_matrix_


def measure(path: Path, name: str) -> list[str]:
    """Rows of the table: the map, and Isomap."""
    worn = [part for part in name.split("_") if part in MODULES]
    skin = next((part for part in worn if part in ("torso", "head")), worn[0])
    q, active = touches(path, name, skin)
    true = filed_positions(path, skin)
    active = active[:, there := ~np.isnan(true[:, 0])]
    touched = active.any(axis=1)
    q, active, true = q[touched], active[touched].astype(float), true[there]
    found = map_receptors(q, active, [str(n) for n in np.flatnonzero(there)])
    known = active.sum(axis=0) >= LEAST_FELT
    rows = []
    for number, part in enumerate(found.parts):
        places, real = found.positions[part.receptors], true[part.receptors]
        score = scores(places, cdist(places, places), real)
        off = np.linalg.norm(align(places, real) - real, axis=1)
        unit = np.linalg.norm(align(places, real) - real.mean(0)) / np.linalg.norm(places)
        within = float((off < 2.0 * unit * found.error[part.receptors]).mean())
        holes = "not sure"
        if part.holes_are_sure and part.topology is not None:
            holes = " ".join(map(str, part.topology.betti))
        extent = float(np.sqrt(np.square(real - real.mean(0)).sum(axis=1).mean()))
        rows.append(
            f"| {name} {skin}, part {number} | {len(real)} of {known.sum()} | {score['rho']:.2f} | "
            f"{score['rms']:.1f} | {score['rigid']:.1f} | {extent:.0f} | {score['near']:.0%} | "
            f"{holes} | {within:.0%} |"
        )
    score = scores(*isomap(active[:, known][active[:, known].any(axis=1)]), true[known])
    rows.append(
        f"| {name} {skin}, Isomap | {known.sum()} of {known.sum()} | {score['rho']:.2f} | "
        f"{score['rms']:.1f} | {score['rigid']:.1f} | | {score['near']:.0%} | | |"
    )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path, help="folder UserData/Robots/Nao/Dataset")
    parser.add_argument("--files", nargs="*", default=[*DEVELOPED, *JUDGED])
    parser.add_argument("--out", type=Path, default=Path("build/nao.md"))
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    lines = [
        "| file and skin | taxels | rho | rms, mm | rigid, mm | extent, mm | near | holes | within "
        "two bars |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    print(*lines, sep="\n")
    for name in given.files:
        rows = measure(given.path, name)
        print(*rows, sep="\n", flush=True)
        lines += rows
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
