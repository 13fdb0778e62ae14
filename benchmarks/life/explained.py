"""Whether a changed body is explained by the right numbers of its chain. Run it as a script.

    python benchmarks/life/explained.py --bodies sphere torus cube --seeds 6
    python benchmarks/life/explained.py --bodies cube --seeds 41 --since 30 60 100

For each body and seed a chain is found from touches of a random walk. Then the body changes, in
each way that `mending.py` knows and that moves joints or skin, or not at all; from first touches
of another walk in the changed body it is explained. Printed are what the agent says, and whether it
names what changed; a skin may be named by a joint that turns it alike, about the same axis.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from selftouch_drake.agent.body_model.chain_change import Change, explained, foretold
from selftouch_drake.agent.body_model.known_chain import KnownChain, found_chain
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.life.mending import changes

#: What a change is to be called.
RIGHT = {
    "turned": Change.TURNED_SKIN,
    "slipped": Change.SKIN,
    "stretched": Change.STRETCHED_SKIN,
    "link": Change.LINK,
    "joint": Change.ZERO,
    "nothing": None,
}


def touched(
    body: str, seed: int, kind: str, walk: int, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Readings and sensations of the first touches of a walk in a body that changed."""
    made = [] if kind == "nothing" else changes(kind, [])[1]
    world = World(load_experiment(body, {"seed": seed, "changes": made}))
    shard = collect_walk(DrakeBodies(world).babbling, world.experiment, walk, number)
    return shard.q.astype(float), shard.sensation.astype(float)


def named(known: KnownChain, kind: str, since: tuple, usual: tuple) -> tuple[bool, str]:
    """Whether the agent names what changed, and what it says."""
    change = explained(known, *foretold(known, usual, since))
    if change is None:
        return kind == "nothing", "nothing that explains it"
    # A turn of the skin about the first joint's axis is that joint's: touch tells no more.
    turns = kind == "turned" and change.kind == Change.ZERO and change.joint == known.joints[0]
    return turns or change.kind == RIGHT[kind], change.in_words


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", nargs="+", default=["sphere", "torus", "cube"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[6])
    parser.add_argument("--kinds", nargs="+", choices=list(RIGHT), default=list(RIGHT))
    parser.add_argument("--before", type=int, default=600, help="touches of the chain")
    parser.add_argument("--since", nargs="+", type=int, default=[50, 100, 200])
    args = parser.parse_args()
    right: dict[tuple[str, int], list[bool]] = {}
    for body in args.bodies:
        for seed in args.seeds:
            began = time.process_time()
            q, sensation = touched(body, seed, "nothing", 0, args.before + 300)
            known = found_chain(q[: args.before], sensation[: args.before], seed=seed)
            print(f"{body} {seed}: chain after {time.process_time() - began:.1f} s", flush=True)
            if known is None:
                print(f"{body} {seed}: no chain")
                continue
            usual = q[args.before :], sensation[args.before :]
            for kind in args.kinds:
                q_since, felt = touched(body, seed, kind, 200, max(args.since))
                for number in args.since:
                    ok, words = named(known, kind, (q_since[:number], felt[:number]), usual)
                    right.setdefault((kind, number), []).append(ok)
                    mark = "right" if ok else "WRONG"
                    print(f"{body} {seed} {kind:9s} {number:4d}: {mark}  {words}", flush=True)
    for (kind, number), found in right.items():
        print(f"{kind} from {number}: {sum(found)} of {len(found)} right")


if __name__ == "__main__":
    main()
