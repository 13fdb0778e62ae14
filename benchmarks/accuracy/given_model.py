"""How well a given model of a robot is put right by touch. Run it as a script.

    python benchmarks/accuracy/given_model.py [--kind offsets] [--experiment torus] [--seeds 20]
        [--first 100]

For each seed, a robot of the package babbles. Each time it comes to its skin, it stops at the first
touch of half a newton, as one would calibrate a robot: 300 touches. Kinds:

- `offsets`: joints read wrong by up to 0.1 rad (uniform; not those whose offset no touch can show),
  5 % of the taxels are dead.
- `swapped`: likewise, but 5 % of the taxels report the readings of another one.
- `numbers`: 20 numbers of the model are wrong: offsets by up to 0.1 rad, turns of frames by up to
  0.03 rad, shifts by up to 10 mm. No touch tells the others apart from them, so the true values are
  those of the model that touches as the robot does and has all numbers that were not looked for as
  they are given.
- `right`: as `numbers`, and a file of the taxels, each off by 1 mm: nothing must be called wrong.
- `wrong`: likewise, but something is wrong: by turns the sign of a joint, an axis, two axes
  exchanged, the readings of two joints exchanged, two taxels exchanged, a triangle turned.

Columns, where they apply:

- places: mm, median and root mean square distance from the true receptors, after a similarity where
  more than offsets was looked for;
- offsets: mrad, root mean square and largest error of those that touches tell;
- toucher: mm, root mean square error of its places over the touches after a similarity, before and
  after;
- cover: share of the true values within the 95 % intervals;
- named: whether what is wrong, and nothing else, was named.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from selftouch_drake.agent.given_model.refit import Refit, refitted
from selftouch_drake.agent.given_model.taxels import compared, told
from selftouch_drake.agent.given_model.way import Change, GivenWay
from selftouch_drake.agent.given_model.wrong import judged_tree
from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.export.given_model import read_way
from selftouch_drake.resources import MODELS
from selftouch_drake.robot import World

NUM_TOUCHES, DEAD, OFFSET, FORCE = 300, 0.05, 0.1, 0.5
NUM_NUMBERS, TURN, SHIFT, TAXEL = 20, 0.03, 0.01, 0.001
MODEL = {"torus": "one_finger", "sphere": "one_finger", "turning_body": "turning_body"}
# Joints whose offsets move the receptors as well.
UNOBSERVABLE = {
    "torus": ("shoulder_yaw",),
    "sphere": ("shoulder_yaw",),
    "turning_body": (),
}
WRONG = ("sign", "axis", "axes", "readings", "taxels", "triangle")
KINDS = ("offsets", "swapped", "numbers", "right", "wrong")
STEPS = 4000
QUANTILE = 1.96


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """Of one seed: the true way, `(n, L)` readings of its joints, `(n, S)` N, `(S, 3)` m."""

    way: GivenWay
    q: np.ndarray
    sensation: np.ndarray
    places: np.ndarray
    radius: float

    def placed(self) -> np.ndarray:
        """Receptors that felt four touches strongly."""
        strong = self.sensation > 0.5 * self.sensation.max(axis=1, keepdims=True)
        return np.flatnonzero(strong.sum(axis=0) >= 4)

    def of_placed(self) -> tuple[np.ndarray, np.ndarray]:
        """Readings of joints and of these receptors."""
        placed = self.placed()
        touched = self.sensation[:, placed].any(axis=1)
        return self.q[touched], self.sensation[np.ix_(touched, placed)].astype(float)


def gentle_touches(name: str, seed: int) -> Touches:
    """Postures at the first touch of a skin from outside, and sensations."""
    experiment = load_experiment(name, {"seed": seed})
    world = World(experiment)
    body, fields = DrakeBody(world), world.skins[0].fields
    mesh = trimesh.Trimesh(fields.vertices, fields.faces, process=False)
    found, number, walk = [], 0, 0
    while number < NUM_TOUCHES:
        path = random_walk(world.experiment, body, walk).steps(STEPS)
        felt, walk = body.feel(path), walk + 1
        total = np.zeros(len(path))
        total[: len(felt.sensation)] = felt.sensation.sum(axis=1)
        comes = felt.reached[1:] & felt.reached[:-1] & (total[:-1] == 0) & (total[1:] > FORCE)
        free, touching = path[:-1][comes], path[1:][comes]
        for _ in range(14):
            middle = (free + touching) / 2
            firm = (world.probe.sensations(middle).sum(axis=1) > FORCE)[:, None]
            free, touching = np.where(firm, free, middle), np.where(firm, middle, touching)
        X_WL, X_WF = world.robot.kinematics.poses(touching).swapaxes(0, 1)
        centre = np.einsum("nji,nj->ni", X_WL[:, :, :3], X_WF[:, :, 3] - X_WL[:, :, 3])
        _, near = mesh.kdtree.query(centre)
        outside = np.einsum("nx,nx->n", centre - mesh.vertices[near], mesh.vertex_normals[near]) > 0
        found.append(touching[outside])
        number += int(outside.sum())
    q = np.concatenate(found)[:NUM_TOUCHES]
    ((_, toucher),) = experiment.touching.items()
    way, columns = read_way(
        MODELS / f"{MODEL[name]}.dmd.yaml", world.robot.joint_names, "body", toucher.frame
    )
    return Touches(way, q[:, columns], world.probe.sensations(q), fields.p_LS, toucher.radius)


def offsets_row(name: str, seed: int, *, swapped: bool) -> dict[str, float]:
    """Joints that read wrong, and taxels that do."""
    touches, rng = gentle_touches(name, seed), np.random.default_rng(seed)
    offsets = rng.uniform(-OFFSET, OFFSET, len(touches.way.names))
    told_ones = np.array([joint not in UNOBSERVABLE[name] for joint in touches.way.names])
    offsets[~told_ones] = 0.0
    bad, order = int(DEAD * len(touches.places)), rng.permutation(len(touches.places))
    sensation = touches.sensation.copy()
    sensation[:, order[:bad]] = sensation[:, order[bad : 2 * bad]] if swapped else 0.0
    touches = replace(touches, q=touches.q - offsets, sensation=sensation)
    found, placed = refitted(touches.way, *touches.of_placed(), touches.radius), touches.placed()
    wrong_ones = np.isin(placed, order[:bad])
    off = (found.places - touches.places[placed])[~wrong_ones]
    apart = 1e3 * np.linalg.norm(off, axis=1)
    of_offsets = [n for n, change in enumerate(found.changes) if change.is_offset]
    number = [found.changes[n].number for n in of_offsets]
    wrong = np.abs(found.amounts[of_offsets] - offsets[number])
    within = np.abs(off) <= QUANTILE * found.place_sigma[~wrong_ones]
    return {
        "receptors": len(placed),
        "places median, mm": float(np.median(apart)),
        "places rms, mm": float(np.sqrt(np.mean(apart**2))),
        "places cover": float(np.mean(within)),
        "offsets told": len(of_offsets),
        "offsets rms, mrad": float(1e3 * np.sqrt(np.mean(wrong**2))),
        "offsets worst, mrad": float(1e3 * wrong.max()),
        "offsets cover": float(np.mean(wrong <= QUANTILE * found.sigma[of_offsets])),
        "other numbers": len(found.changes) - len(of_offsets),
        "suspected": int(found.suspect.sum()),
    }


def with_wrong_numbers(way: GivenWay, rng: np.random.Generator) -> GivenWay:
    """The way with wrong numbers, as a file might give it."""
    every = way.changes()
    some = [every[n] for n in np.sort(rng.permutation(len(every))[:NUM_NUMBERS])]
    size = [OFFSET if c.is_offset else TURN if c.turns else SHIFT for c in some]
    return way.changed(some, size * rng.uniform(-1.0, 1.0, len(some)))


def numbers_row(name: str, seed: int) -> dict[str, float]:
    """Twenty numbers wrong."""
    touches, rng = gentle_touches(name, seed), np.random.default_rng(seed)
    given = with_wrong_numbers(touches.way, rng)
    found, placed = refitted(given, *touches.of_placed(), touches.radius), touches.placed()
    true, rest = true_amounts(given, found.changes, touches)
    z = (found.amounts - true) / found.sigma
    apart = 1e3 * np.linalg.norm(alike(found.places, touches.places[placed]), axis=1)
    return {
        "looked for": len(found.changes),
        "cover": float(np.mean(np.abs(z) < QUANTILE)),
        "z rms": float(np.sqrt(np.mean(z**2))),
        "z worst": float(np.abs(z).max()),
        "not told, mm": 1e3 * rest,
        "toucher before, mm": toucher_error(given, touches),
        "toucher after, mm": toucher_error(found.way, touches),
        "places median, mm": float(np.median(apart)),
    }


def true_amounts(
    given: GivenWay, changes: Sequence[Change], touches: Touches
) -> tuple[np.ndarray, float]:
    """Amounts with which a given way touches as the true one does, and what is left, m rms."""
    q, number = touches.q[::3], len(changes)
    true = touches.way.places(q)
    middle = true.mean(axis=0)

    def off(x: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(x[number : number + 3]).as_matrix()
        moved = (1.0 + x[-1]) * (true - middle) @ turn.T + middle + x[number + 3 : -1]
        return (given.changed(changes, x[:number]).places(q) - moved).ravel()

    found = least_squares(off, np.zeros(number + 7), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return found.x[:number], float(np.sqrt(3.0 * np.mean(found.fun**2)))


def alike(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """`(n, 3)` errors of places after the best similarity."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    U, size, Vt = np.linalg.svd(a.T @ b)
    side = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    return (size * side).sum() / np.square(a).sum() * a @ (U * side) @ Vt - b


def toucher_error(way: GivenWay, touches: Touches) -> float:
    off = alike(way.places(touches.q), touches.way.places(touches.q))
    return float(1e3 * np.sqrt(np.square(off).sum(axis=1).mean()))


def judged_row(name: str, seed: int, wrong: str | None) -> dict[str, float | str]:
    """What is said of a model, with something wrong in it or not."""
    touches, rng = gentle_touches(name, seed), np.random.default_rng(seed)
    given, sensation = with_wrong_numbers(touches.way, rng), touches.sensation
    q, names = touches.q, [str(n) for n in range(len(touches.places))]
    groups, expected = triangles(touches), set()
    joint, other = rng.permutation(len(given.names))[:2]
    if wrong in ("sign", "axis", "axes"):
        axes = given.axes.copy()
        while wrong == "axes" and np.allclose(np.abs(axes[joint]), np.abs(axes[other])):
            joint, other = rng.permutation(len(given.names))[:2]
        if wrong == "axes":
            axes[[joint, other]] = axes[[other, joint]]
            expected = {f"the axes of joints {given.names[n]}" for n in (joint, other)}
        else:
            axes[joint] = -axes[joint] if wrong == "sign" else np.roll(axes[joint], 1)
            expected = {f"joint {given.names[joint]} turns"}
        given = replace(given, axes=axes)
    elif wrong == "readings":
        q = q.copy()
        q[:, [joint, other]] = q[:, [other, joint]]
        expected = {"the readings of joints"}
    placed = touches.placed()
    if wrong == "taxels":
        one, two = rng.permutation(placed)[:2]
        sensation = sensation.copy()
        sensation[:, [one, two]] = sensation[:, [two, one]]
        first, second = sorted((one, two))
        expected = {f"receptors {first} and {second} are exchanged"}
    elif wrong == "triangle":
        group = groups[int(rng.permutation(placed)[0])]
        three = [n for n in placed if groups[n] == group]
        while len(three) < 3:
            group = groups[int(rng.permutation(placed)[0])]
            three = [n for n in placed if groups[n] == group]
        sensation = sensation.copy()
        sensation[:, three] = sensation[:, np.roll(three, 1)]
        expected = {f"triangle {group} is turned by 120 degrees"}
    judged = replace(touches, way=given, q=q, sensation=sensation)
    said = findings(
        judged, touches.places + TAXEL / 3**0.5 * rng.normal(size=(len(names), 3)), groups
    )
    if wrong is None:
        named = not said
    else:
        text = said[0] if len(said) == 1 else ""
        named = (
            all(text.startswith(e) for e in expected)
            if wrong not in ("axes", "readings")
            else (
                text.startswith(next(iter(expected)).split(" joints ")[0])
                and all(given.names[n] in text for n in (joint, other))
            )
        )
    return {
        "wrong": wrong or "nothing",
        "named": float(named),
        "said": "; ".join(said) or "nothing",
    }


def triangles(touches: Touches) -> list[str]:
    """A group for each receptor: the nearest three that are left, one after the other."""
    left, groups = list(range(len(touches.places))), [""] * len(touches.places)
    while left:
        apart = np.linalg.norm(touches.places[left] - touches.places[left[0]], axis=1)
        three = [left[n] for n in np.argsort(apart, kind="stable")[:3]]
        for n in three:
            groups[n] = f"T{three[0]}"
            left.remove(n)
    return groups


def findings(touches: Touches, file: np.ndarray, groups: Sequence[str]) -> list[str]:
    """What is called wrong."""
    q, sensation = touches.of_placed()
    verdict = judged_tree(touches.way, q, sensation)
    said = [verdict.best.text] if verdict.best.text else []
    if not verdict.fits:
        return [*said, "nothing fits"]
    found: Refit = refitted(verdict.best.way, q[:, verdict.best.columns], sensation, touches.radius)
    places, sigma = np.full((2, len(file), 3), np.nan)
    places[touches.placed()], sigma[touches.placed()] = found.places, found.place_sigma
    beside = compared(places, sigma, file)
    return said + told(beside, [str(n) for n in range(len(file))], groups)


def row(kind: str, name: str, seed: int) -> dict[str, float | str]:
    if kind in ("offsets", "swapped"):
        return offsets_row(name, seed, swapped=kind == "swapped")
    if kind == "numbers":
        return numbers_row(name, seed)
    return judged_row(name, seed, WRONG[seed % len(WRONG)] if kind == "wrong" else None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", choices=KINDS, default="offsets")
    parser.add_argument("--experiment", choices=list(MODEL), default="torus")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--out", type=Path, default=Path("build/given_model.md"))
    given = parser.parse_args()
    rows: list[dict[str, float | str]] = []
    lines: list[str] = []
    for seed in range(given.first, given.first + given.seeds):
        rows.append(row(given.kind, given.experiment, seed))
        cells = [v if isinstance(v, str) else f"{v:.3g}" for v in rows[-1].values()]
        if not lines:
            lines += [f"| seed | {' | '.join(rows[-1])} |", "|---" * (len(cells) + 1) + "|"]
            print(*lines, sep="\n")
        lines.append(f"| {seed} | {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    keys = [key for key, value in rows[0].items() if not isinstance(value, str)]
    means = [f"{key} {np.mean([row[key] for row in rows]):.3g}" for key in keys]
    lines.append(f"mean: {', '.join(means)}")
    print(lines[-1])
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
