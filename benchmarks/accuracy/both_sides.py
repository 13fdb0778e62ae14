"""Made-up bodies whose touches both skins feel: limbs, pair, orders and axes from touches alone.

    python benchmarks/accuracy/both_sides.py --seeds 10 11 12 --searches 2

Each seed draws a body: a trunk and a head of two joints, both shells with receptors, and two arms
that mirror each other, of four or five joints with axes and lengths drawn at random, a patch of
skin and a tip at the end of each. It touches itself as a Nao does in eight recordings; each posture
stands in them once. Readings of joints have noise, and one receptor in ten of a touch stays silent.
Columns of the readings are in no order. Given is which skin is at the end of which limb; the rest
is looked for as `others/nao.py` does.

- limbs, pair: whether touches told them; `limbs_argmax`: whether they would have without the rule
  that limbs with the same kinds of ends have as many joints;
- orders; arms_deg, head_deg: the worst angle between axes found and true ones; places: the median
  distance of receptors from the true ones, in diameters of a contact;
- accepted: whether a search begun anew agrees.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from sys import path as search_path
from unittest import mock

import numpy as np
from scipy.spatial.transform import Rotation

from selftouch_drake.agent.body_model.both_sides import limbs as limbs_module
from selftouch_drake.agent.body_model.both_sides.judgement import Found, compared, gap_between
from selftouch_drake.agent.body_model.both_sides.limbs import limbs_of, relevance
from selftouch_drake.agent.body_model.both_sides.orders import found_orders
from selftouch_drake.agent.body_model.both_sides.pairs import paired
from selftouch_drake.agent.body_model.both_sides.problem import Body
from selftouch_drake.agent.body_model.both_sides.recordings import Layout, Recording
from selftouch_drake.agent.body_model.both_sides.search import Problems

search_path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import add_update_option, results

# Which ends meet, in diameters of a contact how far a touching point may be off a shell, rad of
# noise, and the share of receptors that feel a touch and stay silent.
MEET = (
    *(("right_skin", "trunk"), ("left_skin", "trunk"), ("right_tip", "trunk")),
    *(("left_tip", "trunk"), ("right_skin", "head_skin"), ("left_skin", "head_skin")),
    *(("right_tip", "left_skin"), ("left_tip", "right_skin")),
)
HOLDER = {
    **{"trunk": "", "head_skin": "head", "right_skin": "right", "left_skin": "left"},
    **{"right_tip": "right", "left_tip": "left"},
}
SHELL, NOISE, SILENT = 0.05, 0.01, 0.1
TRUNK, HEAD = np.array([2.2, 1.5, 3.0]), np.array([1.3, 1.5, 1.6])
NECK = np.array([0.0, 0.0, 5.0])
MIRROR = np.array([-1.0, 1.0, 1.0])
# What only a search tells.
SEARCHED = ("orders", "arms_orders", "arms_deg", "head_deg", "places", "accepted", "cpu_s")


@dataclass(frozen=True, kw_only=True, eq=False)
class Made:
    """A body: joints of each limb from the trunk on, as columns of the readings.

    Attributes:
        limbs: columns of each limb.
        axes: `(J, 3)` by column.
        centres: `(J, 3)` points on them.
        places: `(n, 3)` receptors of each end, or its single point.
        reach: `(J,)` rad that each joint turns to either side.
    """

    limbs: dict[str, list[int]]
    axes: np.ndarray
    centres: np.ndarray
    places: dict[str, np.ndarray]
    reach: np.ndarray

    def carried(self, end: str, q: np.ndarray, point: np.ndarray, *, back: bool = False):
        """`(n, 3)` points of an end in the frame of the trunk, or the other way round."""
        joints = self.limbs[HOLDER[end]] if HOLDER[end] else []
        for joint in joints if back else reversed(joints):
            turn = Rotation.from_rotvec((-1 if back else 1) * q[:, joint, None] * self.axes[joint])
            point = turn.apply(point - self.centres[joint]) + self.centres[joint]
        return point


def shell(radii: np.ndarray, middle: np.ndarray, number: int) -> np.ndarray:
    """`(number, 3)` points spread evenly over an ellipsoid."""
    at = np.arange(number) + 0.5
    polar, around = np.arccos(1 - 2 * at / number), np.pi * (1 + 5**0.5) * at
    ring = np.sin(polar)
    return middle + radii * np.column_stack(
        [ring * np.cos(around), ring * np.sin(around), np.cos(polar)]
    )


def made(random: np.random.Generator) -> Made:
    """A body at random."""
    number = int(random.integers(4, 6))
    columns = random.permutation(2 * number + 2).tolist()
    right, left, head = columns[:number], columns[number:-2], columns[-2:]
    axes, centres = np.zeros((len(columns), 3)), np.zeros((len(columns), 3))
    reach = np.zeros(len(columns))
    place, heading = np.array([2.6, 0.0, 2.0]), np.array([0.3, 1.0, -0.3])
    before = heading
    for one, other in zip(right, left, strict=True):
        while True:
            axis = random.normal(size=3)
            axis /= np.linalg.norm(axis)
            if abs(axis @ before) < 0.7:
                break
        before = axis
        axes[one], centres[one] = axis, place
        # What turns one way turns the other way in a mirror, or is read so.
        axes[other], centres[other] = -axis * MIRROR * random.choice([-1, 1]), place * MIRROR
        reach[one] = reach[other] = random.uniform(1.0, 1.7)
        place = place + random.uniform(0.3, 1.6) * heading + 0.3 * random.normal(size=3)
    axes[head] = np.eye(3)[[2, 0]]
    centres[head] = NECK - [0, 0, 1.2]
    reach[head] = random.uniform(0.4, 0.9, 2)
    u, v = (own.ravel() for own in np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7)))
    patch = place + np.column_stack([0.9 * np.sin(u), 0.9 * v, 0.9 * np.cos(u)])
    tip = place + heading + [[0, 0.6, 0]]
    return Made(
        limbs={"right": right, "left": left, "head": head}, axes=axes, centres=centres, reach=reach,
        places={
            "trunk": shell(TRUNK, np.zeros(3), 400), "head_skin": shell(HEAD, NECK, 150),
            "right_skin": patch, "left_skin": patch * MIRROR,
            "right_tip": tip, "left_tip": tip * MIRROR,
        },
    )  # fmt: skip


def touching(body: Made, above: str, below: str, number: int, random: np.random.Generator):
    """Recording of touches of two ends.

    Raises:
        ValueError: they hardly ever meet.
    """
    kept_q, kept_above, kept_below = [], [], []
    for _ in range(60):
        q = body.reach * random.uniform(-1, 1, (20_000, len(body.reach)))
        own = body.places[above][random.integers(len(body.places[above]), size=len(q))]
        there = body.carried(below, q, body.carried(above, q, own), back=True)
        if below in ("trunk", "head_skin"):
            radii, middle = (TRUNK, 0) if below == "trunk" else (HEAD, NECK)
            near = np.abs(np.linalg.norm((there - middle) / radii, axis=1) - 1) < SHELL
        else:
            apart = np.linalg.norm(there[:, None] - body.places[below], axis=2)
            near = apart.min(axis=1) < 3 * SHELL
        kept_q.append(q[near])
        kept_above.append(own[near])
        kept_below.append(there[near])
        if sum(map(len, kept_q)) >= number:
            break
    else:
        raise ValueError(f"{above} and {below} hardly ever meet")
    q, own, there = (np.concatenate(one)[:number] for one in (kept_q, kept_above, kept_below))
    return Recording(
        name=f"{above}_{below}", above=above, below=below,
        q=q + NOISE * random.normal(size=q.shape),
        felt_above=felt(body.places[above], own, random),
        felt_below=felt(body.places[below], there, random),
    )  # fmt: skip


def felt(receptors: np.ndarray, contact: np.ndarray, random: np.random.Generator):
    """`(t, n)` receptors within a contact, the nearest one always; None of a point."""
    if len(receptors) == 1:
        return None
    apart = np.linalg.norm(receptors - contact[:, None], axis=2)
    on = (apart < 0.5) & (random.random(apart.shape) >= SILENT)
    on[np.arange(len(contact)), apart.argmin(axis=1)] = True
    return on


def drawn(seed: int, postures: int) -> tuple[Made, list[Recording]]:
    """The first body of a seed whose ends meet, and its touches."""
    random = np.random.default_rng(seed)
    while True:
        body = made(random)
        try:
            return body, [touching(body, *ends, postures, random) for ends in MEET]
        except ValueError:
            continue


def beside_truth(body: Made, found: Found) -> tuple[np.ndarray, float]:
    """`(J,)` degrees between axes and true ones; diameters between receptors and true ones."""
    skins = found.body.skins
    own = {end: found.body.places(found.row, end) for end in skins}
    true = {end: body.places[end][skins[end].receptor] for end in skins}
    here, there = own["trunk"] - own["trunk"].mean(0), true["trunk"] - true["trunk"].mean(0)
    u, _, vt = np.linalg.svd(here.T @ there)
    best = None
    axes = found.body.axes(found.row).astype(float)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for hand in (1, -1):
        turn = u * [1, 1, hand * np.sign(np.linalg.det(u @ vt))] @ vt
        cosine = hand * ((axes @ turn) * body.axes).sum(axis=1)
        angles = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        scale = np.sqrt((there**2).sum() / (here**2).sum())
        off = [
            np.linalg.norm(
                scale * (own[end] - own["trunk"].mean(0)) @ turn
                - (true[end] - true["trunk"].mean(0)),
                axis=1,
            )
            for end in skins
        ]
        if best is None or angles.mean() < best[0].mean():
            best = angles, float(np.median(np.concatenate(off)))
    assert best is not None
    return best


def told(body: Made, recordings: list[Recording]) -> tuple[Layout, dict[str, object]]:
    """Limbs and pair as touches tell them, and whether they are right."""
    begun = Layout(limbs=body.limbs, holder=HOLDER)
    matters = relevance(Body.of(recordings, begun).skins, recordings)
    limbs = limbs_of(matters, recordings, HOLDER)
    with mock.patch.object(limbs_module, "_as_many", lambda score, best, alike: best):
        plain = limbs_of(matters, recordings, HOLDER)
    layout = paired(recordings, Layout(limbs=limbs, holder=HOLDER))
    true_pairs = set(zip(body.limbs["right"], body.limbs["left"], strict=True))
    pairs = [
        set(zip(*(layout.limbs[name] for name in sorted(pair, reverse=True)), strict=True))
        for pair in layout.mirrored
    ]
    right = {name: sorted(joints) for name, joints in body.limbs.items()}
    return layout, {
        "joints": len(body.axes),
        "limbs": limbs == right,
        "limbs_argmax": plain == right,
        "pair": pairs == [true_pairs],
    }


def searched(body: Made, recordings: list[Recording], layout: Layout, seeds: range):
    """What searches found, the first of them beside the truth."""
    began, founds, gap = time.process_time(), [], np.nan
    arms = [*body.limbs["right"], *body.limbs["left"]]
    for seed in seeds:
        problems = Problems.of(recordings, layout, seed)
        some = found_orders(problems, seed)
        founds.append(Found.best(problems.body, some))
        if seed == seeds[0]:
            columns = [list(layout.limbs[name]) for name in layout.limbs if name != "head"]
            gap = gap_between(some, np.array([j for limb in columns for j in limb]))
    found = founds[0]
    angles, places = beside_truth(body, found)
    return {
        "orders": all(list(found.body.layout.limbs[n]) == body.limbs[n] for n in body.limbs),
        "arms_orders": all(
            list(found.body.layout.limbs[n]) == body.limbs[n] for n in ("left", "right")
        ),
        "arms_deg": round(float(angles[arms].max()), 1),
        "head_deg": round(float(angles[body.limbs["head"]].max()), 1),
        "places": round(places, 2),
        "accepted": compared(found, founds[1], gap).accepted if len(founds) > 1 else "",
        "cpu_s": round(time.process_time() - began),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs="*", type=int, default=[10, 11, 12])
    parser.add_argument("--postures", type=int, default=200, help="of each recording")
    parser.add_argument("--searches", type=int, default=2, help="0: limbs and pair alone")
    add_update_option(parser, "both_sides")
    given = parser.parse_args()
    with results("both_sides", update=given.update) as add:
        for seed in given.seeds:
            body, recordings = drawn(seed, given.postures)
            layout, row = told(body, recordings)
            row = {"seed": seed, "postures": given.postures} | row | dict.fromkeys(SEARCHED, "")
            if given.searches and row["limbs"] and row["pair"]:
                row |= searched(body, recordings, layout, range(seed, seed + given.searches))
            print(row, flush=True)
            add(row)


if __name__ == "__main__":
    main()
