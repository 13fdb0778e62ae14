"""How far a recovered shape can be trusted: luck of networks, and what the agent itself expects.

    python benchmarks/trust.py luck --out runs/trust
    python benchmarks/trust.py confidence --out runs/trust --picture docs/images/confidence.png

`luck` recovers six bodies, two of them felt through worn skins, with twenty network seeds each.
`confidence` recovers bodies from few and many touches and targets, through good and bad skins, with
6 to 16 joints, and sets the error that the agent expects beside the true one.

Runs that are missing are babbled; what was computed is kept, and not computed again.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from babbled import babbled
from shape import Case, measure, read

from selftouch_drake.experiment import load_experiment

#: Bodies, skins and seeds of the touches, none of which chose a method.
LUCK = (
    ("sphere", "whole", 921),
    ("cube", "whole", 921),
    ("torus", "whole", 921),
    ("double_torus", "whole", 921),
    ("cube", "worn", 922),
    ("torus", "worn", 922),
)


def luck(arguments: argparse.Namespace) -> None:
    table = arguments.out / "luck.csv"
    networks = [("learned", 10 * number) for number in range(arguments.networks)]
    print("| body | skin | networks | error, median / worst | worst over median | holes |")
    print("|---|---|---|---|---|---|")
    for body, skin, seed in LUCK:
        size = {"seed": seed, "babbling": {"num_samples": arguments.touches}}
        run = babbled(arguments.out / f"{body}_{seed}", load_experiment(body, size))
        case = Case.of(run, skin=skin, samples=arguments.touches, targets=arguments.targets)
        measure(run, [case], networks, table, arguments.out / "cache")
        found = [row for row in read(table) if (row["body"], row["skin"]) == (body, skin)]
        error = np.array([float(row["error"]) for row in found])
        median, worst = np.median(error), error.max()
        holes = "; ".join(f"{b} ({sum(r['betti'] == b for r in found)})" for b in _sets(found))
        print(
            f"| {body} | {skin} | {len(found)} | {median:.1%} / {worst:.1%} "
            f"| {worst / median:.2f} | {holes} |",
            flush=True,
        )


def _sets(found: list[dict[str, str]]) -> list[str]:
    """The numbers of holes that were found, the most frequent first."""
    betti = [row["betti"] for row in found]
    return sorted(set(betti), key=lambda one: -betti.count(one))
