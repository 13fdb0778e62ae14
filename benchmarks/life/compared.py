"""Whether two recordings of one robot say what changed between them, and no more. A script.

    python benchmarks/life/compared.py --bodies cube torus ellipsoid --seeds 31 32 33
    python benchmarks/life/compared.py --bodies cube --seeds 31 --kinds nothing --again 10

For each body and seed the body is found from the first `--touches` touches of a random walk. Each
other recording is of another walk: of the same body, `--again` times, or after one of the changes
that `mending.py` knows and that move joints or skin. Printed is what `selftouch skin A B` says of
the joints, and whether that is right: what changed and nothing else, or nothing where nothing did.
Each is a row of `build/compared.csv`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.two_recordings import Touches, changed_between
from selftouch_drake.quotient.sensations import assign, target_sensations

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.life.explained import RIGHT, is_right, touched
from benchmarks.shared.results import add_update_option, results

# Target sensations, and the first walk of a second recording.
_TARGETS, _WALK = 150, 200


def compared(body: str, seed: int, args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A row for each second recording: what is said of it, and whether that is right."""
    q, felt = touched(body, seed, "nothing", 0, args.touches)
    targets = target_sensations(felt.astype(np.float32), _TARGETS, or_fewer=True)

    def recording(q: np.ndarray, felt: np.ndarray) -> Touches:
        return Touches(q, felt, assign(felt.astype(np.float32), targets)[0])

    before = recording(q, felt)
    names = [f"joint {joint}" for joint in range(q.shape[1])]
    part = np.zeros(len(targets), dtype=int)
    model = find_body_model(q, csr_array(felt), before.target, part, joint_names=names, seed=seed)
    if not model.accepted:
        print(f"{body} {seed}: no body: {model.reason}", flush=True)
        return
    for kind in args.kinds:
        for walk in range(_WALK, _WALK + (args.again if kind == "nothing" else 1)):
            walked = touched(body, seed, kind, walk, max(args.since))
            for number in args.since:
                pairs = changed_between(model, before, recording(*(one[:number] for one in walked)))
                change = pairs[0].change if pairs else None
                yield {
                    "body": body,
                    "seed": seed,
                    "kind": kind,
                    "walk": walk,
                    "touches": number,
                    "noticed": change is not None,
                    "right": bool(pairs) and is_right(kind, change),
                    "said": "nothing" if change is None else change.in_words,
                }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", nargs="+", default=["cube", "torus", "ellipsoid"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[31])
    parser.add_argument("--kinds", nargs="+", choices=RIGHT, default=list(RIGHT))
    parser.add_argument("--touches", type=int, default=2000, help="of the first recording")
    parser.add_argument("--since", nargs="+", type=int, default=[100, 300], help="of the second")
    parser.add_argument("--again", type=int, default=5, help="recordings of an unchanged body")
    add_update_option(parser, "compared")
    args = parser.parse_args()
    found: dict[tuple[str, int], list[dict[str, Any]]] = {}
    with results("compared", update=args.update) as add:
        for body in args.bodies:
            for seed in args.seeds:
                for row in compared(body, seed, args):
                    found.setdefault((row["kind"], row["touches"]), []).append(row)
                    add(row)
                    print(*row.values(), flush=True)
    for (kind, number), rows in found.items():
        noticed, right = (sum(row[what] for row in rows) for what in ("noticed", "right"))
        print(f"{kind} from {number}: {noticed} noticed, {right} right of {len(rows)}")


if __name__ == "__main__":
    main()
