"""What a touch costs an agent that learns the chain of its joints while it touches. A script.

    python benchmarks/cost/online.py cube torus ellipsoid --seeds 31 32
    python benchmarks/cost/online.py --joints 14

Touches of a random walk are taken 50 at a time, as an agent that explores takes them. Printed is
the time of the processor per touch: in the mean, the search for the chain included, and of the last
200 touches; how many touches had accepted a chain at first, and whether the last ones do. A first
agent, whose time does not count, compiles what is compiled. With `--joints`, the body is that of
`joints.py`, a torus on a neck.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from selftouch_drake.agent.body_model.known_chain import ChainLearner

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.joints import experiment_file
from benchmarks.life.explained import touched

# Touches at a time, and the last ones, whose time is told apart.
_BATCH, _LAST = 50, 200


def learned(q: np.ndarray, sensation: np.ndarray, seed: int) -> tuple[np.ndarray, int | None, bool]:
    """Milliseconds of each batch, per touch; the touches that first accepted a chain; the end."""
    learner, spent, first = ChainLearner(seed=seed), [], None
    for start in range(0, len(q), _BATCH):
        began = time.process_time()
        learner.take(q[start : start + _BATCH], sensation[start : start + _BATCH])
        spent.append(1000 * (time.process_time() - began) / _BATCH)
        if first is None and learner.known is not None:
            first = start + _BATCH
    return np.array(spent), first, learner.known is not None


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("experiments", nargs="*")
    parser.add_argument("--joints", nargs="*", type=int, default=[])
    parser.add_argument("--seeds", nargs="+", type=int, default=[31])
    parser.add_argument("--touches", type=int, default=1000)
    args = parser.parse_args()
    print("| body | seed | touches | ms per touch | of the last 200 | chain from | at the end |")
    print("|---|---|---|---|---|---|---|", flush=True)
    compiled = False
    with tempfile.TemporaryDirectory() as folder:
        bodies = {name: name for name in args.experiments}
        bodies |= {
            f"{number} joints": experiment_file(Path(folder), number) for number in args.joints
        }
        for name, body in bodies.items():
            for seed in args.seeds:
                q, sensation = touched(body, seed, "nothing", 0, args.touches)
                if not compiled:
                    learned(q[: 2 * _BATCH], sensation[: 2 * _BATCH], seed)
                    compiled = True
                spent, first, known = learned(q, sensation, seed)
                last = spent[-_LAST // _BATCH :].mean()
                print(
                    f"| {name} | {seed} | {args.touches} | {spent.mean():.1f} | {last:.1f} "
                    f"| {first or 'none'} | {'accepted' if known else 'none'} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
