"""Whether a changed body is explained by the right numbers of its chain. Run it as a script.

    python benchmarks/life/explained.py --bodies sphere torus cube --seeds 6
    python benchmarks/life/explained.py --bodies cube --seeds 41 --since 30 60 100
    python benchmarks/life/explained.py --seeds 6 --kinds tools --since 10
    python benchmarks/life/explained.py --seeds 6 --kinds joint+link joint+stretched --since 100

For each body and seed a chain is found from touches of a random walk. Then the body changes, in
each way that `mending.py` knows and that moves joints or skin, or not at all; from first touches
of another walk in the changed body it is explained. Printed are what the agent says, and whether it
names what changed; a skin may be named by a joint that turns it alike, about the same axis. Two
changes at once are kinds joined by +. With `tools` nothing else changes: the agent takes three
tools in hand, one after another, puts them away, and takes them again, with so many touches each.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from selftouch_drake.agent.body_model.chain_change import ChainChange, Change, explained, foretold
from selftouch_drake.agent.body_model.known_chain import KnownChain, found_chain
from selftouch_drake.agent.body_model.tools import BARE, Hand
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.life.mending import RIGHT as OF_CHAIN
from benchmarks.life.mending import changes

#: What a change is to be called.
RIGHT = {**OF_CHAIN, "nothing": None}
#: Two changes at once that are tried, and tools: metres from where the fingertip touches.
PAIRS = ("joint+link", "joint+slipped", "joint+stretched", "slipped+link")
TOOLS = ([0.06, 0.0, 0.0], [0.02, 0.05, 0.0], [0.0, 0.0, -0.08])
#: What is taken in hand; -1 is nothing.
TAKEN = (-1, 0, -1, 1, -1, 2, 0, 1, 2, -1, 0)


def touched(
    body: str | Path, seed: int, kind: str, walk: int, number: int, tool: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Readings and sensations of the first touches of a walk in a body that changed."""
    made = [one for some in kind.split("+") if some != "nothing" for one in changes(some, [])[1]]
    if tool >= 0:
        made = [*made, {"tools": {"fingertip_0": TOOLS[tool]}}]
    world = World(load_experiment(body, {"seed": seed, "changes": made}))
    shard = collect_walk(DrakeBodies(world).babbling, world.experiment, walk, number)
    return shard.q.astype(float), shard.sensation.astype(float)


def named(known: KnownChain, kind: str, since: tuple, usual: tuple) -> tuple[bool, str]:
    """Whether the agent names what changed, and what it says."""
    change = explained(known, *foretold(known, usual, since))
    words = "nothing that explains it" if change is None else change.in_words
    return is_right(kind, change), words


def is_right(kind: str, change: ChainChange | None) -> bool:
    """Whether a change names what changed, and nothing else; None where nothing did."""
    if change is None:
        return kind == "nothing"
    said = sorted(part.kind.name for part in change.parts)
    ok = said == sorted(right.name for one in kind.split("+") if (right := RIGHT[one]))
    # A turn of the skin about the first joint's axis is that joint's: touch tells no more.
    first = change.parts[0]
    joint = change.before.joints[0]
    turns = kind == "turned" and first.kind == Change.ZERO and first.joint == joint
    return ok or (turns and len(said) == 1)


def tools(
    known: KnownChain, body: str, seed: int, usual: tuple, number: int
) -> Iterator[tuple[bool, str]]:
    """Whether each thing that is taken in hand is known for what it is, and what the agent says."""
    hand, order = Hand(), list[int]()
    for walk, tool in enumerate(TAKEN, start=300):
        touches = touched(body, seed, "nothing", walk, number, tool)
        words = hand.feel(known, *foretold(known, usual, touches))
        if tool >= 0 and tool not in order:
            order.append(tool)
        right = BARE if tool < 0 else order.index(tool)
        yield hand.holds == right and len(hand.tools) == len(order), words


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", nargs="+", default=["sphere", "torus", "cube"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[6])
    every = [*RIGHT, *PAIRS, "tools"]
    parser.add_argument("--kinds", nargs="+", choices=every, default=list(RIGHT))
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
            for number in args.since if "tools" in args.kinds else []:
                for ok, words in tools(known, body, seed, usual, number):
                    right.setdefault(("tools", number), []).append(ok)
                    mark = "right" if ok else "WRONG"
                    print(f"{body} {seed} tools     {number:4d}: {mark}  {words}", flush=True)
            for kind in (kind for kind in args.kinds if kind != "tools"):
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
