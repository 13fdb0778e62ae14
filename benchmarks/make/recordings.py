"""Makes the recordings on which `selftouch score` judges any method, and their truth apart.

    python benchmarks/make/recordings.py --out build/recordings
    python benchmarks/make/recordings.py --bodies cube two_arms --seeds 1 --out recordings

Of each body and seed there is `BODY_SEED.npz`, with all that a method may use:

- `q` `(N, J)` rad or m and `sensation` `(N, S)` N, a row for each touch, in the order of the walks;
- `pairs` `(P, 2)`: plans, if a method makes some, lead from the first of these rows to the second.

`raw` is the cylinder with readings of eight bits, with offsets, gains and noise, in as many rows
with a touch as without, in no order. `BODY_SEED.truth.npz` is for the judge alone: the cells at
which places are judged (patches of about equal width, each with the touches that are on it), their
places, parts, and shares of the receptors in what is felt there; the place of each touch on the
surface of its skin, and the receptors'. The same command gives the same bytes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.evaluation.parts import TouchCounts, true_parts
from selftouch_drake.evaluation.shape import KernelTruth
from selftouch_drake.experience.store import Contacts, ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import written_whole
from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.robot import World
from selftouch_drake.run import stages

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import babbled
from benchmarks.shared.results import ROOT

#: Experiment and number of touches of each body.
BODIES = {
    "sphere": ("sphere", 10_000),
    "cube": ("cube", 10_000),
    "torus": ("torus", 10_000),
    "turning_body": ("turning_body", 10_000),
    "raw": ("cylinder", 6_000),
    "two_arms": ("two_arms", 15_000),
    "infant": ("infant", 15_000),
    "icub": ("icub", 15_000),
}
SEEDS = (1, 2, 3)
NUM_CELLS, NUM_PAIRS = 300, 20
# Cells with fewer touches lie on the ragged rim of what was touched.
LEAST_TOUCHES = 5
# m, between the links of two skins, so that no cell is on both.
APART = 100.0
# Joints and places of touches are rounded to this, rad or m, and sensations to so many bits.
STEP, BITS = 2.0**-12, 7


def rounded(numbers: np.ndarray) -> np.ndarray:
    return (np.round(np.asarray(numbers, dtype=float) / STEP) * STEP).astype(np.float32)


def raw_readings(
    q: np.ndarray, force: np.ndarray, world: World, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Adds rows without a touch; returns q, eight-bit readings, and the touch of each row or -1."""
    rng = np.random.default_rng(seed)
    free = rng.uniform(*world.robot.babbled_range, size=q.shape)
    free = free[~world.probe.sensations(free).any(axis=1)]
    order = rng.permutation(len(q) + len(free))
    touch = np.append(np.arange(len(q)), np.full(len(free), -1))[order]
    readings = np.concatenate([force, np.zeros((len(free), force.shape[1]))])[order]
    readings *= rng.uniform(0.8, 1.2, force.shape[1]) * 120.0 / np.quantile(force[force > 0], 0.9)
    readings += rng.uniform(20, 60, force.shape[1]) + rng.normal(size=readings.shape)
    return (
        np.concatenate([q, free])[order],
        np.rint(readings).clip(0, 255).astype(np.uint8),
        touch,
    )


def cells_of(skin: np.ndarray, places: np.ndarray) -> np.ndarray:
    """`(n,)` the cell of each place, -1 on the rim."""
    apart = places + APART * skin[:, None]
    chosen = farthest_points(lambda one: np.linalg.norm(apart - apart[one], axis=1), NUM_CELLS)
    _, cell = cKDTree(apart[chosen]).query(apart)
    large = np.bincount(cell, minlength=len(chosen)) >= LEAST_TOUCHES
    return np.where(large, np.cumsum(large) - 1, -1)[cell]


def make(body: str, seed: int, out: Path) -> None:
    name, num_touches = BODIES[body]
    experiment = load_experiment(name, {"seed": seed, "babbling": {"num_samples": num_touches}})
    with tempfile.TemporaryDirectory() as folder:
        run = babbled(Path(folder) / "run", experiment)
        world = stages.make_world(run)
        reader = ExperienceReader(run.experience)
        q, sensation = reader.read("q"), reader.read("sensation")
        contacts = Contacts.joined(list(ExperienceReader(run.truth).contacts()))
    fields = [skin.fields for skin in world.skins]
    single = np.flatnonzero(np.diff(contacts.offsets) == 1)
    first = contacts.offsets[single]
    touched = KernelTruth(
        skin=contacts.skin[first].astype(int),
        positions=contacts.p_LC[first].astype(float),
        spread=np.zeros(len(single)),
        share_single=1.0,
    ).on_surface(fields)
    cell = cells_of(touched.skin, touched.positions)
    judged = cell >= 0
    size = np.bincount(cell[judged])
    mean = [np.bincount(cell[judged], x[judged]) / size for x in touched.positions.T]
    skin = np.zeros(len(size), dtype=int)
    skin[cell[judged]] = touched.skin[judged]
    kernels = KernelTruth(
        skin=skin, positions=np.stack(mean, axis=1), spread=np.zeros(len(size)), share_single=1.0
    )
    parts = true_parts(fields, TouchCounts(fields, [contacts]), kernels)
    part = np.full(len(size), -1)
    for number, one in enumerate(parts):
        part[one.kernels] = number
    of_touch = np.full(len(q), -1)
    of_touch[single] = cell
    place = np.full((len(q), 3), np.nan)
    place[single] = touched.positions
    share = sensation / sensation.sum(axis=1, keepdims=True)
    felt = np.zeros((len(size), sensation.shape[1]))
    np.add.at(felt, cell[judged], share[single[judged]])
    mantissa, exponent = np.frexp(sensation)
    sensation = np.ldexp(np.round(np.ldexp(mantissa, BITS)), exponent - BITS).astype(np.float32)
    row = np.arange(len(q))
    if body == "raw":
        q, sensation, row = raw_readings(q, sensation, world, seed)
    in_row = lambda of, none: np.where(  # noqa: E731
        (row >= 0).reshape(-1, *[1] * (of.ndim - 1)), of[row], none
    )
    of_touch = in_row(of_touch, -1)
    rng = np.random.default_rng(seed)
    on_part = np.where(of_touch >= 0, part[of_touch], -1)
    # Where rounding lifts a touch off the skin, no plan begins or ends.
    on_part[~world.probe.sensations(rounded(q).astype(float)).any(axis=1)] = -1
    pairs = rng.choice(np.flatnonzero(on_part >= 0), (100 * NUM_PAIRS, 2))
    same = (on_part[pairs[:, 0]] == on_part[pairs[:, 1]]) & (pairs[:, 0] != pairs[:, 1])
    save(
        out / f"{body}_{seed}.npz",
        q=rounded(q),
        sensation=sensation,
        pairs=pairs[same][:NUM_PAIRS].astype(np.int32),
    )
    save(
        out / f"{body}_{seed}.truth.npz",
        experiment=np.array(name),
        seed=np.array(seed),
        skins=np.array(list(experiment.skins)),
        cell=of_touch.astype(np.int16),
        cell_skin=skin.astype(np.int16),
        cell_part=part.astype(np.int16),
        cell_receptors=(felt / size[:, None]).astype(np.float32),
        part_betti=np.array([one.betti or (-1, -1, -1) for one in parts], dtype=np.int16),
        touch_places=rounded(in_row(place, np.nan)),
        receptor_skin=world.receptor_skin.astype(np.int16),
        receptor_places=np.concatenate([field.p_LS for field in fields]),
    )
    print(f"{out / f'{body}_{seed}.npz'}: {len(q):,} rows, {len(size)} cells, {len(parts)} parts")


def save(path: Path, **arrays: np.ndarray) -> None:
    # One receptor or joint after the other: each changes little from row to row.
    columns = {name: np.asarray(array, order="F") for name, array in arrays.items()}
    with written_whole(path) as aside, aside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **columns)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bodies", nargs="+", choices=BODIES, default=list(BODIES))
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "recordings")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for body in options.bodies:
        for seed in options.seeds:
            make(body, seed, options.out)


if __name__ == "__main__":
    main()
