"""Plans from a recording alone, and in the body that made it. Run it as a script.

    python benchmarks/accuracy/recorded.py --seeds 2 3

The upper body of the tests (`tests/bodies/mujoco_body.py`: twelve joints, 160 touch sites, MuJoCo)
wanders at random at 50 Hz, touching or not, and only its raw readings are kept: eight bits, with
offsets, gains and noise. They are imported and learned as `selftouch` does it. Random pairs of
target sensations of one part are planned, and the body follows each trajectory without dynamics:

- `typical start`: plans from the recording alone, each from the touch most like its first target;
- `recording`: those of `selftouch plan`, each from the start from which it strays least from what
  was recorded;
- `body`: the same pairs, practised in the body, as `selftouch plan --body` does it.

Contact and goals are what the calibrated readings say; `overlap` is the share of the samples at
which rigid parts are in each other.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Felt, Followed
from selftouch_drake.agent.motions import Motion
from selftouch_drake.agent.pilot import Pilot
from selftouch_drake.agent.planning.novelty import Recorded
from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.agent.tries import reached
from selftouch_drake.bodies.checked import CheckedBody
from selftouch_drake.bodies.user_body import UserBody
from selftouch_drake.run.imported import free_rows, imported_experiment, read_data, timed

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import ROOT, add_update_option, results

sys.path.insert(0, str(ROOT / "tests" / "bodies"))
from mujoco_body import Kinematic

RATE_HZ = 50.0
# Rows felt at once.
BATCH = 5000


class RawBody(Kinematic):
    """The body with raw readings, as recorded."""

    def __init__(self, seed: int):
        super().__init__()
        rng = np.random.default_rng([seed, 0])
        self.gain, self.offset = rng.uniform(30, 60, 160), rng.integers(20, 60, 160)
        self.noise = np.random.default_rng([seed, 1])

    def feel(self, q: np.ndarray) -> Felt:
        felt = super().feel(q)
        noise = self.noise.normal(0, 0.6, felt.sensation.shape)
        raw = np.rint(felt.sensation * self.gain + self.offset + noise).clip(0, 255)
        return Felt(q=felt.q, sensation=raw, reached=felt.reached)

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        return Followed(time_s=time_s, q=q, sensation=self.feel(q).sensation)


def record(file: Path, body: RawBody, seed: int, num_rows: int) -> None:
    """Records a smooth random motion; postures with rigid parts in each other are left out."""
    rng, span = np.random.default_rng([seed, 2]), body.upper - body.lower
    v, x = np.zeros(len(span)), rng.uniform(0, span)
    walk = np.empty((num_rows, len(span)))
    for row in range(num_rows):
        v = 0.97 * v + 0.243 * rng.standard_normal(len(span)) * 0.006 * span
        x += v
        turned = x % (2 * span)
        walk[row] = body.lower + np.minimum(turned, 2 * span - turned)
    felt = [body.feel(walk[first : first + BATCH]) for first in range(0, num_rows, BATCH)]
    kept = np.concatenate([some.reached for some in felt])
    np.savez(
        file,
        q=walk[kept].astype(np.float32),
        sensation=np.concatenate([s.sensation.astype(np.uint8) for s in felt])[kept],
        time=np.flatnonzero(kept) / RATE_HZ,
        joint_names=np.array(body.joint_names),
    )


def pairs_within_parts(agent: Agent, num: int) -> list[tuple[int, int]]:
    """Random pairs of target sensations of one part."""
    part, rng = agent.representation.part, np.random.default_rng(0)
    pairs = list[tuple[int, int]]()
    while len(pairs) < num:
        start, goal = rng.choice(len(part), 2, replace=False).tolist()
        if part[start] == part[goal]:
            pairs.append((start, goal))
    return pairs


def judged(motions: list[Motion], body: UserBody, agent: Agent) -> dict[str, float]:
    """Means over motions that the body follows without dynamics."""
    contact, goals, overlap = [], [], []
    for motion in motions:
        felt = body.feel(motion.q)
        contact.append(motion.contact(felt.sensation))
        goals.append(reached(motion, felt.sensation, agent.representation))
        overlap.append(np.mean(~felt.reached))
    return {
        "contact_percent": round(100 * float(np.mean(contact)), 2),
        "contact_worst_percent": round(100 * float(np.min(contact)), 1),
        "reached_percent": round(100 * float(np.mean(goals)), 1),
        "overlap_percent": round(100 * float(np.mean(overlap)), 2),
    }


def measured(seed: int, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows of the table: one recording without its body, and with it."""
    raw, file = RawBody(seed), options.out / f"recording_{seed}.npz"
    if not file.exists():
        record(file, raw, seed, options.rows)
    data = read_data(file)
    experiment = imported_experiment(data, overrides={"seed": seed})
    assert experiment.imported is not None
    felt = data.felt
    agent = Agent.learn(felt.q, felt.sensation, num_targets=options.targets, seed=seed)
    body = UserBody(CheckedBody(raw), felt.baseline)
    recorded = Recorded(agent.representation, free_rows(data, seed)["q"])
    pairs = pairs_within_parts(agent, options.pairs)
    for way in ("typical start", "recording", "body"):
        began, motions = time.process_time(), list[Motion]()
        pilot = Pilot(agent, body, seed=seed)
        for pair in pairs[: options.practised if way == "body" else None]:
            if way == "body":
                with suppress(NoWayError):
                    motions.append(pilot.plan(*pair).motion)
            else:
                first = way == "typical start"
                plan = agent.plan(*pair) if first else recorded.surest(pair, agent.plan)[0]
                motions.append(timed(agent, plan, experiment.imported))
        novelty = [recorded.novelty(motion.plan) for motion in motions]
        seconds = (time.process_time() - began) / len(motions)
        yield {
            "seed": seed,
            "plans": way,
            "touches": len(felt.rows),
            "pairs": len(motions),
            **judged(motions, body, agent),
            "novelty_median": round(float(np.median(novelty)), 1),
            "seconds_per_plan": round(seconds, 2),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("build/recorded"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[2, 3])
    parser.add_argument("--rows", type=int, default=600_000)
    parser.add_argument("--targets", type=int, default=200)
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--practised", type=int, help="pairs practised; by default all")
    add_update_option(parser, "recorded")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with results("recorded", update=options.update) as add:
        for seed in options.seeds:
            for row in measured(seed, options):
                print(row, flush=True)
                add(row)


if __name__ == "__main__":
    main()
