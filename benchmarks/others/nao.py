"""The body of a real Nao, from nothing but its own touches. Run it as a script.

    python benchmarks/others/nao.py body PATH --folds 0 1 2 3 4 --seeds 0 1
    python benchmarks/others/nao.py table PATH
    python benchmarks/others/nao.py nominal PATH
    python benchmarks/others/nao.py limbs PATH
    python benchmarks/others/nao.py unseen PATH
    python benchmarks/others/nao.py picture PATH
    python benchmarks/others/nao.py maps PATH [--files rightArm_torso ...]

PATH is the folder `UserData/Robots/Nao/Dataset` of the public repository
ctu-vras/multirobot-calibration, which has no licence: it is read where it is. Each of its nine
files holds 195 to 1,075 touches, with twelve joints and the taxels that were on; in four of them
both skins felt each touch.

`body` looks for the body on eight files together, one fifth of the *postures* held out in turn, and
keeps what it found. Kinematics, taxels and mounts are unknown; unless `--order given`, so are the
joints of each limb, their order, which limbs are a pair, and which of their joints correspond:
`limbs` prints what touches tell of these. What is given is which skin is at the end of which limb.
A body that was kept is not looked for again. `table` makes the skins of kept bodies finer and
their joints those on which drafts agree, and compares them with the repository's description and
with each other: a row for each fold and seed, and one for the lowest loss of a fold's seeds.
`nominal` fits the same, with as fine skins, from that description, and writes the corrected robot
of each fold as URDF. `unseen` finishes, by least squares and where drafts agree, bodies of the six
files without the two in which hands touch the other arm, and predicts all touches of these two:
bodies that were found so (`body --without-hands`), those found from all eight files, and the
described one.

`maps` says where the taxels of one skin are, by `selftouch map`'s way, and beside it by plain
Isomap on the cosines of shared touches. The filed positions, from another calibration, are the
truth:

- rho: Spearman's rank correlation of distances, along the map and filed;
- rms: mm, root mean square distance from the filed positions after a fit with one scale; rigid:
  the same at the scale that makes the extents equal;
- near: share of the six nearest of each taxel in the map that are within two spacings.

The suppositions of the maps were weighed on the first three files; the others were measured once.
"""

from __future__ import annotations

import argparse
import csv
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from nao_scores import (
    CONTACT,
    FITTED,
    HANDS,
    HEAD,
    JOINTS,
    LAYOUT,
    LEFT,
    MODULES,
    RIGHT,
    Score,
    filed_positions,
    nominal_axes,
    nominal_bodies,
    recording,
    scored,
    touches,
)
from scipy.spatial.distance import cdist
from scipy.stats import spearmanr
from sklearn.manifold import Isomap

from selftouch_drake.agent.body_model.both_sides.finer import FINE, finer, moved_over
from selftouch_drake.agent.body_model.both_sides.finish import finished
from selftouch_drake.agent.body_model.both_sides.judgement import Found, compared, gap_between
from selftouch_drake.agent.body_model.both_sides.limbs import limbs_of, relevance
from selftouch_drake.agent.body_model.both_sides.orders import found_orders
from selftouch_drake.agent.body_model.both_sides.pairs import paired
from selftouch_drake.agent.body_model.both_sides.problem import Body, Population, Problem
from selftouch_drake.agent.body_model.both_sides.recordings import (
    Layout,
    Recording,
    folds_of_postures,
)
from selftouch_drake.agent.body_model.both_sides.search import SIGMA, Problems, found
from selftouch_drake.agent.shape.alignment import align
from selftouch_drake.agent.shape.receptor_map import LEAST_FELT, map_receptors
from selftouch_drake.export.link_tree import WORLD, Ball, Link, LinkTree, Movement
from selftouch_drake.export.urdf import urdf_text

DEVELOPED = ("rightArm_torso", "leftArm_torso", "head_leftFinger")
JUDGED = (
    *("leftArm_head", "torso_leftFinger", "torso_rightFinger"),
    *("leftArm_rightFinger", "rightArm_leftFinger", "rightArm_head"),
)
FOLDS = 5
# By how much axes and points on them are expected to be off their description; chosen on fold 0
# among four pairs, 0.5 and 1.5 to 4 and 10.
EXPECTED_DEGREES, EXPECTED_MM = 2.0, 5.0
# Searches that judge a body.
_AGAIN = 2
KINDS = ("unknown", "given", "unknown_without_hands", "given_without_hands")


def split(
    path: Path, fold: int, files: Sequence[str] = FITTED
) -> tuple[list[Recording], list[Recording]]:
    """Recordings without one fold of their postures, and that fold."""
    train, test = [], []
    for name in files:
        whole = recording(path, name)
        which = folds_of_postures(whole.q[:, LAYOUT.between(whole)], folds=FOLDS)
        train.append(whole.some(np.flatnonzero(which != fold)))
        test.append(whole.some(np.flatnonzero(which == fold)))
    return train, test


@cache
def layout_of(path: Path, fold: int, order: str) -> Layout:
    """The true limbs and orders, or limbs and their pair as touches tell them, joints in any order.

    Which limb holds which skin is given; touches of all eight files tell the rest.
    """
    if order == "given":
        return LAYOUT
    train, _ = split(path, fold)
    told = limbs_of(relevance(Body.of(train, LAYOUT).skins, train), train, LAYOUT.holder)
    limbs = {name: told[name] for name in LAYOUT.limbs}
    return paired(train, Layout(limbs=limbs, holder=LAYOUT.holder))


def draw(given: argparse.Namespace) -> None:
    """A kept body's skeleton and skins from the front and the side, over the described ones."""
    fold, seed = given.folds[0], given.seeds[0]
    kept = {one.seed: one for one in kept_of(given, given.order, given.order, fold)}
    if seed not in kept:
        raise SystemExit(
            f"nao: no body of fold {fold} and seed {seed} in {given.keep}; run "
            f"`nao.py body PATH --folds {fold} --seeds {seed} --order {given.order}` first"
        )
    own = finer(kept[seed].found, kept[seed].train)
    score = scored(own.body, own.row, split(given.path, fold)[1], given.path)
    figure, panels = plt.subplots(1, 2, figsize=(8, 4.2), layout="constrained")
    for panel, (across, name) in zip(
        panels, ((1, "from the front"), (0, "from the side")), strict=True
    ):
        for limb in LAYOUT.limbs:
            _, points, _ = nominal_axes(limb)
            panel.plot(points[:, across], points[:, 2], "o--", color="0.7", ms=4, lw=1)
            panel.plot(*score.centres[limb][:, [across, 2]].T, "o-", color="C3", ms=4, lw=1.5)
            for centre, axis in zip(score.centres[limb], score.directions[limb], strict=True):
                ends = centre + 15 * np.outer([-1, 1], axis)
                panel.plot(ends[:, across], ends[:, 2], color="C3", lw=2.5, alpha=0.5)
        for skin, color in zip(own.body.skins, ("C0", "C1", "C2", "C4"), strict=True):
            place = score.places[skin]
            panel.scatter(place[:, across], place[:, 2], s=3, color=color, label=skin)
        panel.set_aspect("equal")
        panel.set_title(name)
        panel.set_xlabel("mm")
    panels[0].legend(fontsize=7, markerscale=2)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(given.out, dpi=110)


def tell_limbs(given: argparse.Namespace) -> None:
    """Joints of each limb and the pair, told from touches alone, for each fold."""
    for fold in given.folds:
        told = layout_of(given.path, fold, "unknown")
        wrong = [
            f"{JOINTS[joint]} to {name}"
            for name, joints in told.limbs.items()
            for joint in joints
            if joint not in LAYOUT.limbs[name]
        ]
        print(f"fold {fold}: wrong: {', '.join(wrong) or 'none'}")
        for first, second in told.mirrored:
            both = zip(told.limbs[first], told.limbs[second], strict=True)
            pairs = ", ".join(f"{JOINTS[one]} and {JOINTS[other]}" for one, other in both)
            print(f"fold {fold}: {first} and {second} are a pair: {pairs}", flush=True)


def kept_as(keep: Path, order: str, fold: int, seed: int) -> Path:
    return keep / f"{order}_{fold}_{seed}.npz"


def look_for(given: argparse.Namespace) -> None:
    """Bodies of all folds and seeds that are not kept yet."""
    given.keep.mkdir(parents=True, exist_ok=True)
    files = [name for name in FITTED if not (given.without_hands and name in HANDS)]
    kind = f"{given.order}{'_without_hands' if given.without_hands else ''}"
    for seed in given.seeds:
        for fold in given.folds:
            out = kept_as(given.keep, kind, fold, seed)
            if out.exists():
                continue
            began = time.process_time()
            train, _ = split(given.path, fold, files)
            problems = Problems.of(train, layout_of(given.path, fold, given.order), seed)
            look = found if given.order == "given" else found_orders
            best = look(problems, seed)
            seconds = time.process_time() - began
            np.savez(out, rows=best.rows, orders=best.orders, loss=best.loss, seconds=seconds)
            print(f"{out.stem}: {best.loss.round(2).tolist()} in {seconds:.0f} s", flush=True)


def read(path: Path) -> tuple[Population, float]:
    with np.load(path) as file:
        one = Population(rows=file["rows"], orders=file["orders"], loss=file["loss"])
        return one, float(file["seconds"])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kept:
    """A search that was kept: fold and seed, what it saw and found, and its bodies, best first."""

    fold: int
    seed: int
    train: Sequence[Recording]
    found: Found
    some: Population
    seconds: float


def kept_of(given: argparse.Namespace, kind: str, order: str, fold: int) -> list[Kept]:
    """Searches of one kind and fold that were kept, by seed."""
    kept = sorted(given.keep.glob(f"{kind}_{fold}_*.npz"))
    if not kept:
        return []
    files = [name for name in FITTED if not ("without" in kind and name in HANDS)]
    train, _ = split(given.path, fold, files)
    body = Body.of(train, layout_of(given.path, fold, order))
    result = []
    for path in kept:
        some, seconds = read(path)
        seed = int(path.stem.rpartition("_")[2])
        own = Found.best(body, some)
        result.append(
            Kept(fold=fold, seed=seed, train=train, found=own, some=some, seconds=seconds)
        )
    return result


def tabulate(given: argparse.Namespace) -> None:
    """A row for each kept body, beside the description and the next two that were kept.

    Bodies of one kind are in a ring, by seed and fold: each is judged by the next two, which began
    anew on other postures; one of them must agree. Of one alone a right body is refused wherever
    that one is wrong. The lowest losses of all folds are a ring of their own.
    """
    rows = []
    for kind in KINDS:
        order = kind.partition("_")[0]
        kept = [one for fold in range(FOLDS) for one in kept_of(given, kind, order, fold)]
        kept.sort(key=lambda one: (one.seed, one.fold))
        rows += _ring(given.path, kind, kept)
        lowest = [_lowest([one for one in kept if one.fold == fold]) for fold in range(FOLDS)]
        if kind == "unknown":
            rows += _ring(given.path, "unknown_lowest", [one for one in lowest if one])
    given.out.parent.mkdir(parents=True, exist_ok=True)
    with given.out.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows([{k: _text(v) for k, v in row.items()} for row in rows])
    for row in rows:
        print({k: _text(v) for k, v in row.items()})


def _lowest(seeds: Sequence[Kept]) -> Kept | None:
    """The search that ended lowest; it cost the time of all."""
    if not seeds:
        return None
    best = min(seeds, key=lambda one: float(one.some.loss[0]))
    return replace(best, seconds=sum(one.seconds for one in seeds))


def _ring(path: Path, kind: str, kept: Sequence[Kept]) -> list[dict[str, object]]:
    """Rows of bodies that are judged by those after them."""
    rows = []
    order = kind.partition("_")[0]
    for at, one in enumerate(kept):
        number = min(_AGAIN, len(kept) - 1)
        again = [kept[(at + step) % len(kept)] for step in range(1, number + 1)]
        own: dict[str, object] = {"limbs_found": "given", "pair_found": "given"}
        if order != "given":
            told = layout_of(path, one.fold, "unknown")
            pairs = (zip(*(told.limbs[n] for n in pair), strict=True) for pair in told.mirrored)
            own = {
                "limbs_found": all(
                    set(told.limbs[name]) == set(joints) for name, joints in LAYOUT.limbs.items()
                ),
                "pair_found": {frozenset(pair) for pair in pairs}
                == {frozenset(zip(RIGHT, LEFT, strict=True))},
            }
        own |= row_of(one, again, split(path, one.fold)[1], path)
        if order == "given":
            own |= dict.fromkeys(("arms_order_found", "head_order_found"), "given")
        rows.append({"order": kind, "fold": one.fold, "seed": one.seed} | own)
    return rows


def row_of(
    one: Kept, again: Sequence[Kept], test: list[Recording], path: Path
) -> dict[str, object]:
    """What one search found, beside the description and other searches; skins are made finer."""
    some, limbs = one.some, one.found.body.layout.limbs
    fine = finer(one.found, one.train)
    score = scored(fine.body, fine.row, test, path)
    gap = gap_between(some, np.array([*LEFT, *RIGHT]))
    result: dict[str, object] = {
        "arms_order_found": [*limbs["left"], *limbs["right"]] == [*LEFT, *RIGHT],
        "head_order_found": list(limbs["head"]) == HEAD,
        "loss": float(some.loss[0]),
        "gap": gap,
        "gap_head": gap_between(some, np.array(HEAD)),
        "apart_median_deg": np.nan,
        "apart_worst_deg": np.nan,
        "accepted": "",
    }
    if again:
        verdicts = [compared(one.found, other.found, gap) for other in again]
        verdict = min(verdicts, key=lambda verdict: (not verdict.accepted, verdict.angles.max()))
        result |= {
            "apart_median_deg": float(np.median(verdict.angles)),
            "apart_worst_deg": float(verdict.angles.max()),
            "accepted": verdict.accepted,
        }
    return result | _columns(score) | {"cpu_s": one.seconds}


def _columns(score: Score) -> dict[str, object]:
    axes = {
        f"{JOINTS[joint]}_deg": angle
        for limb, joints in LAYOUT.limbs.items()
        for joint, angle in zip(joints, score.axes[limb], strict=True)
    }
    worst: dict[str, object] = {
        "arms_worst_deg": score.worst("left", "right"),
        "head_worst_deg": score.worst("head"),
    }
    files = {f"{name}_mm": value for name, value in score.held_out.items()}
    shuffled: dict[str, object] = {"shuffled_least_mm": min(score.shuffled.values())}
    taxels = {f"taxels_{skin}_mm": value for skin, value in score.taxels.items()}
    return worst | axes | files | shuffled | taxels


def _text(value: object) -> object:
    return f"{value:.2f}" if isinstance(value, float) else value


def fit_nominal(given: argparse.Namespace) -> None:
    """From the repository's description: joints held, then corrected; medians of held-out mm."""
    print("| fold | joints | " + " | ".join(FITTED) + " | worst axis of arms, of head |")
    print("|---" * (len(FITTED) + 3) + "|")
    for fold in given.folds:
        train, test = split(given.path, fold)
        body = Body.of(train, LAYOUT, FINE)
        whole = Problem.of(body, train)
        held = body.free(joints=[])
        some = nominal_bodies(body, 24, np.random.default_rng(0), given.path)
        some = whole.descended(some, steps=300, rate=0.03, sigmas=(3.0, 0.3), free=held).best(8)
        some = whole.descended(some, steps=600, rate=0.02, sigmas=(0.6, SIGMA), free=held).best()
        expected = np.full(body.length, np.inf)
        body.axes(expected)[:] = np.radians(EXPECTED_DEGREES)
        body.centres(expected)[:] = EXPECTED_MM / CONTACT
        after = finished(whole, some, sigma=SIGMA, steps=40, expected=expected)
        for name, one in (("as described", some), ("corrected", after)):
            score = scored(body, one.rows[0], test, given.path)
            cells = [f"{score.held_out[file]:.1f}" for file in FITTED]
            axes = f"{score.worst('left', 'right'):.0f}, {score.worst('head'):.0f}"
            print(f"| {fold} | {name} | " + " | ".join(cells) + f" | {axes} |", flush=True)
        given.out.mkdir(parents=True, exist_ok=True)
        text = urdf_text(corrected(score, train))
        (given.out / f"nao_{fold}.urdf").write_text(text, encoding="utf-8")


def corrected(score: Score, recordings: Sequence[Recording]) -> LinkTree:
    """The fitted robot in the frame and unit of its description; limits are what was read."""
    q = np.concatenate([one.q for one in recordings])
    ball = Ball(centre=np.zeros(3), radius=0.02, mass=0.1)
    links = [Link(name="torso", parent=WORLD, offset=np.zeros(3), movement=None, ball=ball)]
    for limb, joints in LAYOUT.limbs.items():
        parent, before = "torso", np.zeros(3)
        for joint, centre, axis in zip(
            joints, score.centres[limb], score.directions[limb], strict=True
        ):
            movement = Movement(
                name=JOINTS[joint], kind="revolute", axis=axis, lower=float(q[:, joint].min()),
                upper=float(q[:, joint].max()), comment="fitted to touches",
            )  # fmt: skip
            name, place = f"{JOINTS[joint]}_link", 1e-3 * centre
            links.append(
                Link(name=name, parent=parent, offset=place - before, movement=movement, ball=ball)
            )
            parent, before = name, place
    return LinkTree(name="nao", links=links, comments=["lengths in m"])


def predict_unseen(given: argparse.Namespace) -> None:
    """Bodies of six files, finished by least squares, and the two files that they never saw."""
    hands = [recording(given.path, name) for name in HANDS]
    heads = ["fold", "seed", "began", "finished", "loss", "worst axis of arms, of head", *HANDS]
    print(f"| {' | '.join(heads)} |")
    print("|---|---|---|---|---|---|---|---|")
    for fold in given.folds:
        train, _ = split(given.path, fold, [name for name in FITTED if name not in HANDS])
        problems = Problems.of(train, LAYOUT, 0)
        for seed, began, some in _begun(given, problems, fold):
            after = finished(problems.whole, some, sigma=SIGMA)
            begun = Found(body=problems.body, row=some.rows[0], order=some.orders[0])
            fine = finer(begun, train)
            for said, loss, body, row in (
                ("no", f"{some.loss[0]:.2f}", problems.body, some.rows[0]),
                ("yes", f"{after.loss[0]:.2f}", problems.body, after.rows[0]),
                ("drafts", "", fine.body, fine.row),
            ):
                score = scored(body, row, hands, given.path)
                axes = f"{score.worst('left', 'right'):.0f}, {score.worst('head'):.0f}"
                cells = [str(fold), str(seed), began, said, loss, axes]
                cells += [f"{score.held_out[name]:.1f}" for name in HANDS]
                print(f"| {' | '.join(cells)} |", flush=True)


def _begun(
    given: argparse.Namespace, problems: Problems, fold: int
) -> Iterator[tuple[int, str, Population]]:
    """Bodies of six files to finish: seed, where it began, and the body."""
    body, whole = problems.body, problems.whole
    for one in kept_of(given, "given_without_hands", "given", fold):
        yield one.seed, "six files", one.some.best()
    columns = np.arange(body.num_joints)[None]
    for one in kept_of(given, "unknown", "unknown", fold):
        # A body of another order has no row here.
        if {name: [*limb] for name, limb in one.found.body.layout.limbs.items()} == LAYOUT.limbs:
            row = moved_over(one.found, body)
            yield one.seed, "eight files", whole.evaluated(row[None], columns, SIGMA)
    held = body.free(joints=[])
    some = nominal_bodies(body, 24, np.random.default_rng(0), given.path)
    some = whole.descended(some, steps=300, rate=0.03, sigmas=(3.0, 0.3), free=held).best(8)
    yield (
        0,
        "described",
        whole.descended(some, steps=600, rate=0.02, sigmas=(0.6, SIGMA), free=held).best(),
    )


def scores(found: np.ndarray, along: np.ndarray, true: np.ndarray) -> dict[str, float]:
    pairs, apart = np.triu_indices(len(true), 1), cdist(true, true)
    np.fill_diagonal(apart, np.inf)
    spacing = np.median(np.sort(apart, axis=1)[:, :6])
    laid = cdist(found, found)
    np.fill_diagonal(laid, np.inf)
    near = np.take_along_axis(apart, np.argsort(laid, axis=1)[:, :6], axis=1)
    rms = lambda places: float(np.sqrt(np.square(places - true).sum(axis=1).mean()))  # noqa: E731
    fitted = align(found, true)
    grown = np.linalg.norm(true - true.mean(0)) / np.linalg.norm(fitted - fitted.mean(0))
    return {
        "rho": spearmanr(along[pairs], apart[pairs])[0],
        "rms": rms(fitted),
        "rigid": rms((fitted - fitted.mean(0)) * grown + fitted.mean(0)),
        "near": float((near <= 2.0 * spacing).mean()),
    }


def isomap(active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    norm = np.linalg.norm(active, axis=0)
    cosines = active.T @ active / np.outer(norm, norm)
    distance = np.sqrt(np.maximum(2.0 - 2.0 * cosines, 0.0))
    np.fill_diagonal(distance, 0.0)
    fitted = Isomap(n_neighbors=8, n_components=3, metric="precomputed").fit(distance)
    return fitted.embedding_, fitted.dist_matrix_


def measure(path: Path, name: str) -> list[str]:
    """Rows of the table: the map, and Isomap."""
    worn = [part for part in name.split("_") if part in MODULES]
    skin = next((part for part in worn if part in ("torso", "head")), worn[0])
    q, active = touches(path, name, skin)
    true = filed_positions(path, skin)
    active = active[:, there := ~np.isnan(true[:, 0])]
    touched = active.any(axis=1)
    q, active, true = q[touched], active[touched].astype(float), true[there]
    found = map_receptors(q, active, [str(n) for n in np.flatnonzero(there)])
    known = active.sum(axis=0) >= LEAST_FELT
    rows = []
    for number, part in enumerate(found.parts):
        places, real = found.positions[part.receptors], true[part.receptors]
        score = scores(places, cdist(places, places), real)
        off = np.linalg.norm(align(places, real) - real, axis=1)
        unit = np.linalg.norm(align(places, real) - real.mean(0)) / np.linalg.norm(places)
        within = float((off < 2.0 * unit * found.error[part.receptors]).mean())
        holes = "not sure"
        if part.holes_are_sure and part.topology is not None:
            holes = " ".join(map(str, part.topology.betti))
        extent = float(np.sqrt(np.square(real - real.mean(0)).sum(axis=1).mean()))
        rows.append(
            f"| {name} {skin}, part {number} | {len(real)} of {known.sum()} | {score['rho']:.2f} | "
            f"{score['rms']:.1f} | {score['rigid']:.1f} | {extent:.0f} | {score['near']:.0%} | "
            f"{holes} | {within:.0%} |"
        )
    score = scores(*isomap(active[:, known][active[:, known].any(axis=1)]), true[known])
    rows.append(
        f"| {name} {skin}, Isomap | {known.sum()} of {known.sum()} | {score['rho']:.2f} | "
        f"{score['rms']:.1f} | {score['rigid']:.1f} | | {score['near']:.0%} | | |"
    )
    return rows


def draw_maps(given: argparse.Namespace) -> None:
    warnings.simplefilter("ignore")
    lines = [
        "| file and skin | taxels | rho | rms, mm | rigid, mm | extent, mm | near | holes | within "
        "two bars |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    print(*lines, sep="\n")
    for name in given.files:
        rows = measure(given.path, name)
        print(*rows, sep="\n", flush=True)
        lines += rows
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ways = parser.add_subparsers(dest="way", required=True)
    maps, body, table, nominal, limbs, unseen = (
        ways.add_parser(name) for name in ("maps", "body", "table", "nominal", "limbs", "unseen")
    )
    for way in (maps, body, table, nominal, limbs, unseen):
        way.add_argument("path", type=Path, help="folder UserData/Robots/Nao/Dataset")
    maps.add_argument("--files", nargs="*", default=[*DEVELOPED, *JUDGED])
    maps.add_argument("--out", type=Path, default=Path("build/nao.md"))
    maps.set_defaults(run=draw_maps)
    for way in (body, nominal, limbs, unseen):
        way.add_argument("--folds", nargs="*", type=int, default=list(range(FOLDS)))
    body.add_argument("--seeds", nargs="*", type=int, default=[0, 1])
    body.add_argument("--order", choices=("given", "unknown"), default="unknown")
    body.add_argument("--without-hands", action="store_true", help="without hand-to-hand files")
    body.set_defaults(run=look_for)
    for way in (body, table, unseen):
        way.add_argument("--keep", type=Path, default=Path("build/nao"), help="found bodies")
    table.add_argument("--out", type=Path, default=Path("build/nao.csv"))
    table.set_defaults(run=tabulate)
    nominal.add_argument("--out", type=Path, default=Path("build/nao"), help="corrected robots")
    nominal.set_defaults(run=fit_nominal)
    unseen.set_defaults(run=predict_unseen)
    limbs.set_defaults(run=tell_limbs)
    picture = ways.add_parser("picture")
    picture.add_argument("path", type=Path, help="folder UserData/Robots/Nao/Dataset")
    picture.add_argument("--folds", nargs=1, type=int, default=[0])
    picture.add_argument("--seeds", nargs=1, type=int, default=[0])
    picture.add_argument("--order", choices=("given", "unknown"), default="unknown")
    picture.add_argument("--keep", type=Path, default=Path("build/nao"), help="found bodies")
    picture.add_argument("--out", type=Path, default=Path("build/nao.png"))
    picture.set_defaults(run=draw)
    given = parser.parse_args()
    given.run(given)


if __name__ == "__main__":
    main()
