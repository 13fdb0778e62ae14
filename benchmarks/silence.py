"""How soon dead receptors are noticed, and how near to a false alarm their test comes.

    python benchmarks/silence.py --bodies torus --seeds 6

An agent learns what to expect from 12,000 random touches in the kinematic world, and what is usual
from 3000 more. Then it watches 100,000 touches of the unchanged body: the greatest statistic of the
test of silence is printed as a share of what raises the alarm. From 20 moments of these touches on,
one receptor or a tenth of them are dead: after how many touches is that noticed?
"""

from __future__ import annotations

import argparse
import copy

import numpy as np
from mending import BODIES, touches

from selftouch_drake.agent.lifelong import Expectation
from selftouch_drake.agent.lifelong.alarm import ReceptorTest
from selftouch_drake.agent.lifelong.expectation import with_unit_norm
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

#: Touches from which the agent learns, touches until it watches, and touches in all.
LEARNED, KNOWN, ALL = 12_000, 15_000, 115_000
#: Touches at which receptors die, and touches for which they are watched.
MOMENTS, WATCHED = range(20_000, 100_000, 4000), 2000


def watched(body: str, seed: int) -> None:
    """Prints what the test finds in one body."""
    walks, taken = touches(World(load_experiment(body, {"seed": seed})), 0, 2500), []
    while sum(len(q) for q, _ in taken) < ALL:
        taken.append(next(walks))
    q, felt = (np.concatenate(column) for column in zip(*taken, strict=True))
    expectation = Expectation.learn(q[:LEARNED], felt[:LEARNED], seed=seed)

    def expected(q: np.ndarray) -> np.ndarray:
        return with_unit_norm(expectation(q))

    test = DeadReceptorTest.calibrated(expected(q[LEARNED:KNOWN]), felt[LEARNED:KNOWN])
    fresh, doubt = copy.deepcopy(test), 0.0
    for start in range(KNOWN, len(q), 500):
        rows = slice(start, start + 500)
        test.watch(expected(q[rows]), felt[rows])
        doubt = max(doubt, test.doubt)
    print(f"{body} {seed}: greatest statistic {doubt:.2f} of its threshold")
    num = felt.shape[1]
    dying = np.random.default_rng(1).choice(num, num // 10, replace=False)
    for dead in (dying[:1], dying):
        after = []
        for start in MOMENTS:
            rows = slice(start, start + WATCHED)
            silent = felt[rows].copy()
            silent[:, dead] = 0.0
            some = silent.any(axis=1)
            row = copy.deepcopy(fresh).watch(expected(q[rows][some]), silent[some])
            after.append(np.inf if row is None else row + 1)
        print(f"{len(dead)} dead: noticed after {np.median(after):.0f}, at most {max(after):.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=BODIES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    args = parser.parse_args()
    for body in args.bodies:
        for seed in args.seeds:
            watched(body, seed)


if __name__ == "__main__":
    main()
