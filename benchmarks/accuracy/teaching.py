"""Touches of a lesson until the body is accepted: `selftouch teach` with a body that moves itself.

    python benchmarks/accuracy/teaching.py torus --seeds 1 2 3
    python benchmarks/accuracy/teaching.py two_arms --person --seeds 1 2 3

For each seed the robot of an experiment is taught from its first touch on. With `--person` a
simulated person moves it, one limb at a time, and does what the lesson asks for: touches the
receptors that it names with the joints that it names, as well as they can. Printed are the touches
after which a body was first accepted, those after which the lesson ended, whether the run that is
made of it has an accepted body, and the seconds of processor time.
"""

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from selftouch_drake.agent.body import Body
from selftouch_drake.agent.lesson import Step
from selftouch_drake.bodies.embodiment import make_bodies
from selftouch_drake.experiment import load_experiment
from selftouch_drake.run.artifacts import load_body_model
from selftouch_drake.run.streams import Callback, MovingBody, Stream
from selftouch_drake.run.teaching import Lesson, Look, columns_of, teach_and_learn

# Touches of one posture of the limbs that stand still, and postures that are tried for them.
_TOUCHES, _TRIED = 10, 3000
# Postures of the other limbs after which a person gives up to touch what was asked for.
_PATIENCE = 20


class Person:
    """Moves one limb after the other by hand, and does what the lesson asks for.

    Which joints make a limb is seen: those of one model of the robot. So is where receptors are:
    of postures drawn at random those are taken that touch them, and no second skin. A limb is
    touched by moving another one, unless the lesson says which.

    Args:
        body: the robot; any posture may be asked for.
        skins: model that carries each skin, and its number of receptors.
        seed: of what the person draws.
    """

    def __init__(self, body: Body, skins: Sequence[tuple[str, int]], seed: int):
        self._body, self._random = body, np.random.default_rng(seed)
        skin = np.repeat(np.arange(len(skins)), [number for _, number in skins])
        self._of_skin = np.eye(len(skins), dtype=bool)[skin]
        models = [name.rpartition("::")[0] for name in body.joint_names]
        limbs = {model: np.flatnonzero([model == one for one in models]) for model in models}
        self._limbs = list(limbs.values())
        self._carries = np.array([[model == own for own, _ in skins] for model in limbs])[:, skin]
        self._turn = 0

    def read(self, steps: Sequence[Step]) -> tuple[np.ndarray, np.ndarray]:
        """Some touches; the callback of a lesson."""
        asked = [step for step in steps if step.receptors]
        step = asked[self._random.integers(len(asked))] if asked else None
        for _ in range(_PATIENCE):
            q, sensation = self._touches(self._limb(step))
            touches = ((sensation > 0) @ self._of_skin).sum(axis=1) == 1
            wanted = touches
            if step is not None:
                wanted = touches & sensation[:, list(step.receptors)].any(axis=1)
            rows = np.flatnonzero(wanted)[:_TOUCHES]
            if len(rows) >= _TOUCHES // 2:
                return q[rows], sensation[rows]
        rows = np.flatnonzero(touches)[:_TOUCHES]
        return q[rows], sensation[rows]

    def _limb(self, step: Step | None) -> np.ndarray:
        """Joints that move: the limb of those that were asked for, or the next one."""
        if step is not None and len(step.joints):
            return max(self._limbs, key=lambda limb: len(np.intersect1d(limb, step.joints)))
        limbs = self._limbs
        if step is not None:
            carries = self._carries[:, list(step.receptors)].all(axis=1)
            limbs = [limb for limb, own in zip(limbs, carries, strict=True) if not own] or limbs
        self._turn += 1
        return limbs[self._turn % len(limbs)]

    def _touches(self, limb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Postures of a limb at random, the others in one posture in which nothing touches."""
        lower, upper = np.asarray(self._body.lower), np.asarray(self._body.upper)
        while True:
            rest = self._body.feel(self._random.uniform(lower, upper, (20, len(lower))))
            free = np.flatnonzero(rest.reached & ~rest.sensation.any(axis=1))
            if len(free):
                break
        q = np.repeat(rest.q[free[:1]], _TRIED, axis=0)
        q[:, limb] = self._random.uniform(lower[limb], upper[limb], (_TRIED, len(limb)))
        felt = self._body.feel(q)
        return felt.q[felt.reached], felt.sensation[felt.reached]


def taught(name: str, seed: int, most: int, folder: Path, person: bool) -> list[str]:
    """The cells of a row."""
    experiment = load_experiment(name, {"seed": seed})
    body = make_bodies(experiment).babbling
    skins = [
        (skin.link.rpartition("::")[0], skin.num_receptors) for skin in experiment.skins.values()
    ]
    lesson = Lesson(
        folder=folder / f"{name}-{seed}",
        how=columns_of(body.joint_names) | {"offset": 0.0, "threshold": 1e-6, "filtering": "none"},
        most=most,
        limits=np.stack([body.lower, body.upper]),
        seed=seed,
    )
    looks: list[Look] = []

    def stream(stored: bytes) -> Stream:
        if person:
            teacher = Person(body, skins, seed + len(stored))
            return Callback(teacher.read, body.joint_names, bool(stored))
        return MovingBody(body, seed + len(stored), bool(stored))

    began = time.process_time()
    last, run = teach_and_learn(
        lesson,
        stream,
        looks.append,
        lambda done, doing: None,
    )
    seconds = time.process_time() - began
    first = next((str(n.known.num_touches) for n in looks if n.known.accepted), "never")
    ended = "no touch" if last is None else str(last.known.num_touches)
    enough = "yes" if last is not None and last.known.is_enough else "no"
    accepted = "no run" if run is None else str(load_body_model(run).accepted)
    return [first, ended, enough, accepted, f"{seconds:.0f}"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("experiments", nargs="+")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(1, 6)))
    parser.add_argument("--touches", type=int, default=1500, help="after which a lesson ends")
    parser.add_argument("--person", action="store_true", help="a simulated person moves it")
    parser.add_argument("--out", type=Path, help="folder of the lessons")
    args = parser.parse_args()
    print("experiment      seed  accepted at  ended at  enough  run accepted  s")
    with tempfile.TemporaryDirectory() as aside:
        for name in args.experiments:
            for seed in args.seeds:
                cells = taught(name, seed, args.touches, args.out or Path(aside), args.person)
                print(
                    f"{name:14s}  {seed:4d}  {cells[0]:11s}  {cells[1]:8s}  {cells[2]:6s}",
                    f"{cells[3]:12s}  {cells[4]}",
                    sep="  ",
                    flush=True,
                )


if __name__ == "__main__":
    main()
