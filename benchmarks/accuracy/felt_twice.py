"""A body from touches that both skins feel, with and without what the hand felt.

    python benchmarks/accuracy/felt_twice.py --seeds 1 2 3 --sizes 0.9 0.4
    python benchmarks/accuracy/felt_twice.py --lesson --touches 300 1000 --seeds 1 2 3

The right arm and the trunk of a body of `both_sides.py`: a bent square of skin, a hand, is met
anywhere where it crosses the trunk's shell. `size` is half its side; the trunk's half axes are 2.2,
1.5 and 3. An agent learns from both skins (`both`), and from the trunk's alone (`one`). With
--lesson the body is looked for as `selftouch teach` does, and places are those of receptors.

- parts: how many it told apart (two skins, and perhaps rims);
- accepted: whether held-out touches agree with the body found, on the trunk;
- places, places_worst: mean and worst error of the places of kernels, % of their extent;
- axes_deg: the worst angle between an axis found and the true one.
"""

import argparse
import itertools
import time
from pathlib import Path
from sys import path as search_path

import numpy as np

search_path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.both_sides import TRUNK, Made, made
from benchmarks.shared.results import add_update_option, results
from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.asking import kernel_of_rows
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.lesson import ask
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

# How far a touching point may be off the shell, rad of noise, reach of a receptor, and half the
# side of the hand as it is drawn.
SHELL, NOISE, REACH, DRAWN = 0.03, 0.005, 0.6, 0.9


def touches(seed: int, number: int, size: float):
    """A body, `(n, J)` readings of its right arm, and `(n, 3)` what met, on the hand and there."""
    random = np.random.default_rng(seed)
    while True:
        body = made(random)
        hand = body.places["right_skin"]
        body.places["right_skin"] = hand.mean(axis=0) + (hand - hand.mean(axis=0)) * size / DRAWN
        kept: list[tuple[np.ndarray, ...]] = []
        for _ in range(200):
            q = body.reach * random.uniform(-1, 1, (20_000, len(body.reach)))
            own = body.places["right_skin"][random.integers(len(hand), size=len(q))]
            there = body.carried("right_skin", q, own)
            near = np.abs(np.linalg.norm(there / TRUNK, axis=1) - 1) < SHELL
            kept.append((q[near], own[near], there[near]))
            if sum(len(one[0]) for one in kept) >= number:
                q, own, there = (np.concatenate(one)[:number] for one in zip(*kept, strict=True))
                q = q[:, sorted(body.limbs["right"])]
                return body, q + NOISE * random.normal(size=q.shape), own, there


def pressed(receptors: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """`(n, S)` readings that fall with the distance; the nearest receptor always feels."""
    apart = np.linalg.norm(contact[:, None] - receptors, axis=2)
    felt, nearest = np.maximum(0, 1 - apart / REACH), apart.argmin(axis=1)
    rows = np.arange(len(contact))
    felt[rows, nearest] = np.maximum(felt[rows, nearest], 0.05)
    return felt.astype(np.float32)


def kernels_met(learned: QuotientRepresentation, there: np.ndarray) -> np.ndarray:
    """`(K, 3)` mean place of the touches `(n, 3)` of each kernel."""
    kernel, place, size = kernel_of_rows(learned), there[learned.kernel_row], learned.num_targets
    sums = np.stack([np.bincount(kernel, axis, size) for axis in place.T], axis=1)
    return sums / np.maximum(np.bincount(kernel, minlength=size), 1)[:, None]


def beside_truth(
    model: BodyModel, place: np.ndarray, true: np.ndarray, body: Made
) -> dict[str, object]:
    """Places `(n, 3)` and axes beside the true ones; nothing if no place is known."""
    if not np.isfinite(place).any():
        return dict.fromkeys(("places", "places_worst", "axes_deg"), "")
    known = np.isfinite(place).all(axis=1)
    own, true = (one[known] - one[known].mean(axis=0) for one in (place, true))
    u, s, vt = np.linalg.svd(own.T @ true)
    off = np.linalg.norm(s.sum() / (own**2).sum() * own @ u @ vt - true, axis=1)
    off *= 100 / np.linalg.norm(np.ptp(true, axis=0))
    # A mirror image turns the other way round.
    turn, hand = u @ vt, np.sign(np.linalg.det(u @ vt))
    found = hand * model.twists[:, :3] @ turn
    found /= np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-12)
    cosine = (found * body.axes[sorted(body.limbs["right"])]).sum(axis=1)
    return {
        "places": round(float(off.mean()), 2),
        "places_worst": round(float(off.max()), 2),
        "axes_deg": round(float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).max()), 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs="*", type=int, default=[1, 2, 3])
    parser.add_argument("--sizes", nargs="*", type=float, default=[0.9, 0.4])
    parser.add_argument("--touches", nargs="*", type=int, default=[12_000])
    parser.add_argument("--targets", type=int, default=160)
    parser.add_argument("--lesson", action="store_true", help="as `selftouch teach`")
    add_update_option(parser, "felt_twice")
    given = parser.parse_args()
    cases = itertools.product(given.sizes, given.seeds, given.touches)
    with results("felt_twice_lesson" if given.lesson else "felt_twice", update=given.update) as add:
        for size, seed, number in cases:
            body, q, own, there = touches(seed, number, size)
            trunk = pressed(body.places["trunk"], there)
            hand = pressed(body.places["right_skin"], own)
            for way, felt in (("both", np.hstack([trunk, hand])), ("one", trunk)):
                began = time.process_time()
                row: dict[str, object] = {"size": size, "seed": seed, "skins": way}
                row |= {"joints": q.shape[1]}
                if given.lesson:
                    model = ask(q, felt, [f"joint {n}" for n in range(q.shape[1])])
                    assert model is not None, f"{number} touches are too few"
                    place, true = model.receptor_place[: len(trunk[0])], body.places["trunk"]
                    row |= {"touches": number, "accepted": model.accepted}
                else:
                    agent = Agent.learn(q, felt, num_targets=given.targets, seed=0)
                    model, learned = agent.find_body_model(), agent.representation
                    place, true = model.kernel_place, kernels_met(learned, there)
                    row |= {
                        "parts": int(learned.part.max()) + 1,
                        "accepted": bool(model.accepted_by_part[0]),
                    }
                row |= beside_truth(model, place, true, body)
                row["cpu_s"] = round(time.process_time() - began)
                print(row, flush=True)
                add(row)


if __name__ == "__main__":
    main()
