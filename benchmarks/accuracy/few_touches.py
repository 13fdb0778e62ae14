"""Bodies from few touches: the first ones of a walk, by what they feel like and by labels alone.

    python benchmarks/accuracy/few_touches.py cube torus ellipsoid --seeds 21 22 23 24 25
    python benchmarks/accuracy/few_touches.py turning_body --touches 300 1000 2000 --seeds 21
    python benchmarks/accuracy/few_touches.py cube --seeds 21 --corrupt mixed 0.1
    python benchmarks/accuracy/few_touches.py cube --seeds 21 --skin noise 0.2
    python benchmarks/accuracy/few_touches.py cube --seeds 21 --labels

For each seed an experiment is babbled (or taken from --runs), its joints are shuffled, and the body
is found from the first touches of the walk. Printed are, in % of the skin's extent after one
similarity, over the touches that were not used: the error of places against the true contact, and
against the true centre of the toucher; whether the order of joints is right, whether the body was
accepted, and the seconds of processor time.
"""

import argparse
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from body_model import CORRUPTIONS, Truth, corrupted, misfit, order_right, the_truth
from scipy.sparse import csr_array, vstack

from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.quotient.sensations import assign, target_sensations
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.stages import make_world

#: What can be wrong with the skin, by an amount.
SKIN = {
    "noise": "on each reading, times the reading",
    "bits": "readings have so many",
    "dead": "receptors that never read anything",
}
# Touches that score a body, and the most targets that few touches are given.
_SCORED, _MOST_TARGETS = 10_000, 150


class Stored(NamedTuple):
    """What a walk touched: readings, sensations, the truth, and the toucher in the skin's frame."""

    q: np.ndarray
    sensation: csr_array
    truth: Truth
    tip: np.ndarray


class Row(NamedTuple):
    """What became of some touches."""

    contact: float
    tip: float
    right: bool
    accepted: bool
    seconds: float


def babbled(name: str, seed: int, touches: int, folder: Path) -> Stored:
    """Touches of the experiment; babbled if they are not there."""
    path = folder / f"{name}-{seed}"
    if not (path / "experience").exists():
        from click.testing import CliRunner

        from selftouch_drake.cli import cli

        changes = f"{{seed: {seed}, babbling: {{num_samples: {touches}}}}}"
        CliRunner().invoke(
            cli, ["babble", name, "--out", str(path), "--set", changes], catch_exceptions=False
        )
    run = RunDirectory.open(path)
    reader = ExperienceReader(path / "experience")
    q = reader.read("q").astype(float)
    sensation = vstack([csr_array(some) for some in reader.batches("sensation")], format="csr")
    truth = the_truth(path, np.arange(len(q)))
    robot = make_world(run).robot
    X_WL = robot.skin_positions(q)[np.arange(len(q)), truth.skin]
    p_WT = robot.toucher_positions(q)[np.arange(len(q)), truth.toucher]
    tip = np.einsum("nba,nb->na", X_WL[:, :, :3], p_WT - X_WL[:, :, 3])
    return Stored(q, sensation, truth, tip)


def worn(sensation: csr_array, how: list[str] | None) -> csr_array:
    """Readings of a skin that has a fault."""
    if not how:
        return sensation
    kind, amount, random = how[0], float(how[1]), np.random.default_rng(12)
    changed = sensation.copy()
    if kind == "noise":
        changed.data = changed.data * (1 + amount * random.standard_normal(changed.data.shape))
        changed.data = np.maximum(changed.data, 0).astype(sensation.dtype)
    elif kind == "bits":
        step = changed.data.max() / (2**amount - 1)
        changed.data = (np.round(changed.data / step) * step).astype(sensation.dtype)
    elif kind == "dead":
        dead = random.permutation(changed.shape[1])[: int(amount)]
        changed.data[np.isin(changed.indices, dead)] = 0
    else:
        raise SystemExit(f"--skin is {kind!r}: {', '.join(SKIN)}")
    changed.eliminate_zeros()
    return changed


def found(
    q: np.ndarray, sensation: csr_array, seed: int, args: argparse.Namespace
) -> tuple[BodyModel, float]:
    """The body of the touches, and the seconds that it took."""
    readings = sensation.astype(np.float32)
    targets = target_sensations(readings.toarray(), min(len(q) // 3, _MOST_TARGETS), or_fewer=True)
    labels, _ = assign(readings.toarray(), targets)
    began = time.process_time()
    with ThreadPoolExecutor(args.threads) as pool:
        model = find_body_model(
            q, None if args.labels else readings, labels, np.zeros(len(targets), dtype=int),
            joint_names=[f"joint {joint}" for joint in range(q.shape[1])], seed=seed,
            each=pool.map,
        )  # fmt: skip
    return model, time.process_time() - began


def look(name: str, seed: int, number: int, stored: Stored, args: argparse.Namespace) -> Row:
    """Finds the body from the first touches, and scores it on others."""
    q, _ = corrupted(stored.q, np.zeros(len(stored.q), dtype=int), args.corrupt)
    shuffled = np.random.default_rng(seed + 99).permutation(q.shape[1])
    q = q[:, shuffled]
    model, seconds = found(q[:number], worn(stored.sensation[:number], args.skin), seed, args)
    right, contact, tip = "no", np.nan, np.nan
    if len(model.toucher_link) > 0:
        chain = model.chain(int(model.toucher_link[0]))
        right = order_right(name, [int(shuffled[joint]) for joint in chain])
        rest = number + np.flatnonzero(stored.truth.single[number:])[:_SCORED]
        place = model.place(q[rest], np.zeros(len(rest), dtype=int))
        known = np.isfinite(place).all(axis=1)
        if known.sum() > 20:
            true, centre = stored.truth.place[rest[known]], stored.tip[rest[known]]
            extent = float(np.linalg.norm(np.ptp(true, axis=0)))
            contact, tip = (misfit(place[known], there, extent) for there in (true, centre))
    print(
        f"{name:14s} seed {seed:3d}  {number:5d} touches  contact {contact:6.2f}",
        f"tip {tip:6.2f} %  order right {right:3s}  accepted {model.accepted!s:5s}",
        f"near {model.held_out[0]:.3f}  {seconds:5.1f} s",
        sep="  ",
        flush=True,
    )
    return Row(contact, tip, right == "yes", model.accepted, seconds)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("experiments", nargs="+")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(21, 31)))
    parser.add_argument("--touches", nargs="+", type=int, default=[50, 100, 300, 1000])
    parser.add_argument("--stored", type=int, default=12_000, help="touches that are babbled")
    parser.add_argument("--runs", type=Path, default=Path("runs/few_touches"))
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--labels", action="store_true", help="by labels alone")
    kinds = "; ".join(f"{kind}: {what}" for kind, what in CORRUPTIONS.items())
    parser.add_argument("--corrupt", nargs=2, metavar=("KIND", "AMOUNT"), help=kinds)
    of_skin = "; ".join(f"{kind}: {what}" for kind, what in SKIN.items())
    parser.add_argument("--skin", nargs=2, metavar=("KIND", "AMOUNT"), help=of_skin)
    args = parser.parse_args()
    for name in args.experiments:
        rows: dict[int, list[Row]] = {number: [] for number in args.touches}
        for seed in args.seeds:
            stored = babbled(name, seed, args.stored, args.runs)
            for number in args.touches:
                rows[number].append(look(name, seed, number, stored, args))
        for number, some in rows.items():
            contact, tip = (
                np.array([getattr(row, key) for row in some]) for key in Row._fields[:2]
            )
            print(
                f"{name} from {number}: contact median {np.nanmedian(contact):.2f}",
                f"worst {np.nanmax(contact):.2f} %, tip median {np.nanmedian(tip):.2f}",
                f"worst {np.nanmax(tip):.2f} %, order right {sum(row.right for row in some)},",
                f"accepted {sum(row.accepted for row in some)} of {len(some)},",
                f"{np.median([row.seconds for row in some]):.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
