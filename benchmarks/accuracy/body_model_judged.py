"""How often right bodies are accepted and wrong ones rejected, on many cheap cases.

    python benchmarks/accuracy/body_model_judged.py                      # all kinds
    python benchmarks/accuracy/body_model_judged.py --kinds right mixed --seeds 100 101 102
    python benchmarks/accuracy/body_model_judged.py --touches 1000 --kernels 80

The bodies are made up (`made_up_bodies.py`): chains of two to nine joints that turn or slide, in
any order, units and signs, and what is no chain. One line for each case, and at the end how many of
each kind were accepted, with the margin: the largest and the smallest share of near touches.
"""

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np
from body_model import misfit
from made_up_bodies import WRONG, case

from selftouch_drake.agent.body_model.find import find_body_model


class Row(NamedTuple):
    """What became of a case."""

    kind: str
    seed: int
    right: bool
    accepted: bool
    near: float
    inliers: float
    place: float
    seconds: float
    text: str


def look(kind: str, seed: int, touches: int, kernels: int) -> Row:
    """Finds the body of a case and judges it."""
    made = case(kind, seed, touches=touches, kernels=kernels)
    began = time.process_time()
    model = find_body_model(
        made.q, None, made.target, made.part,
        joint_names=[f"joint {slot}" for slot in made.slots], seed=seed,
    )  # fmt: skip
    seconds = time.process_time() - began
    place = model.place(made.q, made.target) if len(model.toucher_link) else np.full((1, 3), np.nan)
    kept = np.isfinite(place).all(axis=1)
    error = misfit(place[kept], made.place[kept], 1.0) if kept.sum() > 20 else np.nan
    extent = float(np.linalg.norm(np.ptp(made.place, axis=0)))
    return Row(
        kind, seed, made.right, model.accepted, float(model.held_out[0]), float(model.inliers[0]),
        error / extent, seconds, f"{made.what}; {len(model.toucher_link)} touchers; {model.reason}",
    )  # fmt: skip


def looked(rows: Sequence[tuple[str, int, int, int]], jobs: int) -> list[Row]:
    """All cases, each printed as it is done."""
    found = []
    with ProcessPoolExecutor(jobs) as pool:
        for row in pool.map(look, *zip(*rows, strict=True)):
            print(
                f"{row.kind:12s} seed {row.seed:4d}  accepted {row.accepted!s:5s}",
                f"near {row.near:.3f}  inliers {row.inliers:.3f}  place {row.place:6.2f} %",
                f"{row.seconds:6.1f} s  {row.text}",
                sep="  ",
                flush=True,
            )
            found.append(row)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--kinds", nargs="+", default=["right", "planar", "short", *WRONG])
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(8)))
    parser.add_argument("--touches", type=int, default=0)
    parser.add_argument("--kernels", type=int, default=300)
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    cases = [(k, seed, args.touches, args.kernels) for k in args.kinds for seed in args.seeds]
    rows = looked(cases, args.jobs)
    for kind in args.kinds:
        of_kind = [row for row in rows if row.kind == kind]
        near = np.array([row.near for row in of_kind])
        near = near[np.isfinite(near)] if np.isfinite(near).any() else np.array([np.nan])
        seconds = np.array([row.seconds for row in of_kind])
        print(
            f"{kind:12s} accepted {sum(row.accepted for row in of_kind)} of {len(of_kind)},",
            f"near {near.min():.3f} to {near.max():.3f},",
            f"{np.median(seconds):.1f} s (worst {seconds.max():.1f})",
        )


if __name__ == "__main__":
    main()
