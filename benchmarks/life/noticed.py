"""How soon a chain shows that its body changed, and whether it does where nothing did.

    python benchmarks/life/noticed.py --bodies cube torus ellipsoid --seeds 31 32
    python benchmarks/life/noticed.py --bodies cube --seeds 31 --kinds stretched --watched 500

For each body and seed a chain is found from 600 of the first 4,000 touches of a random walk; 1,000
more say how far it usually takes what touches from where sensations say. The alarm of a life then
watches `--watched` touches of the same body, and first touches of the body after each kind of
change that `mending.py` knows and that moves joints or skin. Printed are the touch that raises the
alarm, and the greatest evidence as a share of what raises it.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from selftouch_drake.agent.body_model.known_chain import KnownChain, found_chain
from selftouch_drake.agent.lifelong.alarm import PlaceTest

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.life.explained import touched

KINDS = ("turned", "slipped", "stretched", "link", "joint")
# Touches among which those of the chain are, of the chain, and that say what is usual.
_EARLY, _OF_CHAIN, _USUAL = 4000, 600, 1000
# Touches of a changed body that are watched at most, and that are foretold at a time.
_SINCE, _AT_ONCE = 500, 1000


def watched(
    known: KnownChain, usual: tuple[np.ndarray, ...], touches: tuple[np.ndarray, ...]
) -> tuple[int | None, float]:
    """The row that raises the alarm, and the greatest evidence as a share of what raises it."""
    test, evidence = PlaceTest(*known.misplaced(*usual)), 0.0
    for start in range(0, len(touches[0]), _AT_ONCE):
        q, sensation = (one[start : start + _AT_ONCE] for one in touches)
        row = test.watch(*known.misplaced(q, sensation))
        evidence = max(evidence, test.doubt[0])
        if row is not None:
            return start + row, evidence
    return None, evidence


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", nargs="+", default=["cube", "torus", "ellipsoid"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[31])
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument("--watched", type=int, default=7000, help="touches without a change")
    args = parser.parse_args()
    rows: dict[str, list[float]] = {}
    for body in args.bodies:
        for seed in args.seeds:
            began = time.process_time()
            number = _EARLY + _USUAL + args.watched
            q, sensation = touched(body, seed, "nothing", 0, number)
            some = np.sort(np.random.default_rng(seed).permutation(_EARLY)[:_OF_CHAIN])
            known = found_chain(q[some], sensation[some], seed=seed)
            if known is None:
                print(f"{body} {seed}: no chain", flush=True)
                continue
            usual, rest = slice(_EARLY, _EARLY + _USUAL), slice(_EARLY + _USUAL, None)
            usual_touches = q[usual], sensation[usual]
            for kind in ("nothing", *args.kinds):
                touches = (q[rest], sensation[rest])
                if kind != "nothing":
                    touches = touched(body, seed, kind, 200, _SINCE)
                row, evidence = watched(known, usual_touches, touches)
                rows.setdefault(kind, []).append(np.inf if row is None else row + 1.0)
                said = "no alarm" if row is None else f"alarm after {row + 1} touches"
                print(f"{body} {seed} {kind:9s}: {said}, evidence {evidence:.2f}", flush=True)
            print(f"{body} {seed}: {time.process_time() - began:.0f} s", flush=True)
    for kind, found in rows.items():
        alarms = int(np.isfinite(found).sum())
        when = f"median {np.median(found):.0f}, worst {np.max(found):.0f}" if alarms else ""
        print(f"{kind}: {alarms} of {len(found)} alarms {when}", flush=True)


if __name__ == "__main__":
    main()
