"""Bodies from few touches: the first ones of a walk, by what they feel like and by labels alone.

    python benchmarks/accuracy/few_touches.py cube torus ellipsoid --seeds 21 22 23 24 25
    python benchmarks/accuracy/few_touches.py turning_body --touches 300 1000 2000 --seeds 21
    python benchmarks/accuracy/few_touches.py cube --seeds 21 --corrupt mixed 0.1
    python benchmarks/accuracy/few_touches.py cube --seeds 21 --skin noise 0.2
    python benchmarks/accuracy/few_touches.py cube --seeds 21 --labels
    python benchmarks/accuracy/few_touches.py cube --seeds 21 --touches 300 1000 --ways walk chosen

For each seed an experiment is babbled (or taken from --runs), its joints are shuffled, and the body
is found from the first touches of the walk. Printed are, in % of the skin's extent after one
similarity, over the touches that were not used: the error of places against the true contact, and
against the true centre of the toucher; whether the order of joints is right, whether the body was
accepted, and the seconds of processor time. Each is a row of `build/few_touches.csv`, too;
`--table` gives that another name.

Way `chosen` explores the experiment's body, from the seed, as `strategy: active` does, and is
scored on the walk's touches. Further columns are the error of the skin, that is of the places that
300 target sensations are said to have, against the mean of the centre's in their kernels; and the
way that the joints went, in thousands of steps of the random walk.
"""

import argparse
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from body_model import CORRUPTIONS, Truth, corrupted, misfit, order_right, the_truth
from scipy.sparse import csr_array, vstack

from selftouch_drake.agent.body import Body, Felt
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.smoothness import Sensed
from selftouch_drake.bodies.embodiment import make_bodies
from selftouch_drake.experience.collect import walk_sizes
from selftouch_drake.experience.exploration import Exploration
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experience.walk import strides
from selftouch_drake.experiment import load_experiment
from selftouch_drake.quotient.sensations import assign, target_sensations
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.stages import make_world

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import results

#: What can be wrong with the skin, by an amount.
SKIN = {
    "noise": "on each reading, times the reading",
    "bits": "readings have so many",
    "dead": "receptors that never read anything",
}
# Touches that score a body, and the most targets that few touches are given.
_SCORED, _MOST_TARGETS = 10_000, 150
# Target sensations whose places are to be foretold.
_SKIN = 300


class Stored(NamedTuple):
    """What a walk touched: readings, sensations, the truth, and the toucher in the skin's frame.

    Of the skin: target sensations, and the mean place of the toucher in each.
    """

    q: np.ndarray
    sensation: csr_array
    truth: Truth
    tip: np.ndarray
    step: np.ndarray
    skin: tuple[np.ndarray, np.ndarray]


class Touched(NamedTuple):
    """Touches that a body is found from, and the way to each, in steps of the random walk."""

    q: np.ndarray
    sensation: csr_array
    went: np.ndarray


class Row(NamedTuple):
    """What became of some touches."""

    contact: float
    tip: float
    skin: float
    went: float
    right: bool
    accepted: bool
    near: float
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
    readings = sensation.toarray().astype(np.float32)
    targets = target_sensations(readings, _SKIN, or_fewer=True)
    kernel, _ = assign(readings, targets)
    middle = np.stack([tip[kernel == number].mean(axis=0) for number in range(len(targets))])
    # More than a walk holds are no few touches.
    step = np.concatenate(list(reader.steps())).astype(float)
    return Stored(q, sensation, truth, tip, step, (targets, middle))


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


class Odometer:
    """A body that counts how far its joints went, in strides."""

    def __init__(self, body: Body, stride: np.ndarray):
        self._body, self._stride = body, stride
        self._at: np.ndarray | None = None
        self.went = np.zeros(1)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._body, name)

    def feel(self, q: np.ndarray) -> Felt:
        path = q if self._at is None else np.concatenate([self._at[None], q])
        steps = np.sqrt(np.mean((np.diff(path, axis=0) / self._stride) ** 2, axis=1))
        if self._at is None:
            steps = np.append(0.0, steps)
        self._at = q[-1]
        self.went = np.append(self.went, self.went[-1] + np.cumsum(steps))
        return self._body.feel(q)


def walked(stored: Stored) -> Touched:
    """The touches of the stored walk."""
    return Touched(stored.q, stored.sensation, stored.step)


def explored(name: str, seed: int, number: int) -> Touched:
    """As many touches that an active agent chooses."""
    babbling = {"strategy": "active", "num_samples": number}
    experiment = load_experiment(name, {"seed": seed, "babbling": babbling})
    body = make_bodies(experiment).babbling
    odometer = Odometer(body, strides(body, experiment.babbling.step_size))
    exploration = Exploration(experiment, odometer)
    q, sensation, went = [], [], []
    for size in walk_sizes(experiment):
        before = len(odometer.went) - 1
        shard = exploration.explore(size)
        exploration.remember(shard.q, shard.sensation)
        q.append(shard.q.astype(float))
        sensation.append(csr_array(shard.sensation))
        went.append(odometer.went[1 + before + shard.step])
    return Touched(np.concatenate(q), vstack(sensation, format="csr"), np.concatenate(went))


def look(
    name: str, seed: int, number: int, stored: Stored, used: Touched, args: argparse.Namespace
) -> Row:
    """Finds the body from the first touches, and scores it on others, of the walk."""
    q, _ = corrupted(stored.q, np.zeros(len(stored.q), dtype=int), args.corrupt)
    mine, _ = corrupted(used.q, np.zeros(len(used.q), dtype=int), args.corrupt)
    shuffled = np.random.default_rng(seed + 99).permutation(q.shape[1])
    q, mine = q[:, shuffled], mine[:number, shuffled]
    sensation = worn(used.sensation[:number], args.skin)
    model, seconds = found(mine, sensation, seed, args)
    right, contact, tip, skin = "no", np.nan, np.nan, np.nan
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
            felt = Sensed.of(sensation)
            own = model.place(mine, np.zeros(len(mine), dtype=int))
            targets, middle = stored.skin
            skin = misfit(felt.predicted(own, felt.like(csr_array(targets))), middle, extent)
    went = float(used.went[number - 1]) / 1000
    print(
        f"{name:14s} seed {seed:3d}  {number:5d} touches  contact {contact:6.2f}",
        f"tip {tip:6.2f} %  skin {skin:6.2f} %  went {went:6.1f} k",
        f"order right {right:3s}  accepted {model.accepted!s:5s}",
        f"near {model.held_out[0]:.3f}  {seconds:5.1f} s",
        sep="  ",
        flush=True,
    )
    return Row(contact, tip, skin, went, right == "yes", model.accepted, model.held_out[0], seconds)


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
    parser.add_argument("--table", default="few_touches", help="name of the table of all rows")
    parser.add_argument("--ways", nargs="+", choices=("walk", "chosen"), default=["walk"])
    parser.add_argument("--labels", action="store_true", help="by labels alone")
    kinds = "; ".join(f"{kind}: {what}" for kind, what in CORRUPTIONS.items())
    parser.add_argument("--corrupt", nargs=2, metavar=("KIND", "AMOUNT"), help=kinds)
    of_skin = "; ".join(f"{kind}: {what}" for kind, what in SKIN.items())
    parser.add_argument("--skin", nargs=2, metavar=("KIND", "AMOUNT"), help=of_skin)
    args = parser.parse_args()
    fault = " ".join([*(args.corrupt or []), *(args.skin or []), *["labels"][: args.labels]])
    with results(args.table) as add:
        for name in args.experiments:
            rows: dict[tuple[str, int], list[Row]] = {}
            for seed in args.seeds:
                stored = babbled(name, seed, args.stored, args.runs)
                for way in args.ways:
                    most = max(args.touches)
                    used = walked(stored) if way == "walk" else explored(name, seed, most)
                    for number in args.touches:
                        row = look(name, seed, number, stored, used, args)
                        rows.setdefault((way, number), []).append(row)
                        case = {"body": name, "fault": fault, "seed": seed, "way": way}
                        add(case | {"touches": number} | row._asdict())
            for (way, number), some in rows.items():
                print(f"{name} {way} {number}: {summary(some)}", flush=True)


def summary(rows: list[Row]) -> str:
    """Median and worst of some rows, and how many are right, accepted, or accepted and wrong."""
    means = ", ".join(
        f"{key} median {np.nanmedian(column):.2f} worst {np.nanmax(column):.2f} {unit}"
        for key, unit in (("contact", "%"), ("tip", "%"), ("skin", "%"), ("went", "k"))
        for column in [np.array([getattr(row, key) for row in rows])]
    )
    wrong = sum(row.accepted and not row.right for row in rows)
    return (
        f"{means}, order right {sum(row.right for row in rows)}, "
        f"accepted {sum(row.accepted for row in rows)} of {len(rows)}, of which wrong {wrong}, "
        f"{np.median([row.seconds for row in rows]):.1f} s"
    )


if __name__ == "__main__":
    main()
