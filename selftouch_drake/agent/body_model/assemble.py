"""From what a fit found to a `BodyModel`: raw readings, kinds of joints, skin, standard errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.judge import Judgement
from selftouch_drake.agent.body_model.model import BASE, UNUSED, BodyModel, JointKind, Receptors
from selftouch_drake.agent.body_model.receptor_places import middles_of_fields
from selftouch_drake.agent.body_model.refine import moved_by, place_slopes
from selftouch_drake.agent.body_model.scene import (
    Scene,
    Solution,
    kernel_sums,
    solution_places,
)
from selftouch_drake.agent.body_model.sizes import outward_normals
from selftouch_drake.agent.body_model.support import nearest_toucher, shape_moved
from selftouch_drake.agent.body_model.tree import Tree, for_readings

# A receptor lies where touches press it at least half as hard as the receptor that they press most.
_PRESSED = 0.5
# A dimension of the space counts if places spread in it so many times more than kernels do.
_SPREAD = 4.0
# Touches by which errors of the size of the skin are measured, and the step of differences.
_MEASURED, _STEP = 20_000, 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What a fit found, and what it was fitted to.

    Attributes:
        tree: of joints.
        scene: all touches that may be explained.
        rows: `(n,)` indices of the scene's touches among all R.
        solution: of the scene.
        center: `(J,)` of the readings.
        scale: `(J,)` of the readings.
        kind: `(J,)` values of `JointKind`.
        order_group: `(J,)` as in `BodyModel`.
        judgements: of each part.
        seed: of the fit.
        spread: `(n, n)` covariance of the solution's twists and points, without the gauge; NaN for
            what the fit held or nothing depends on.
    """

    tree: Tree
    scene: Scene
    rows: np.ndarray
    solution: Solution
    center: np.ndarray
    scale: np.ndarray
    kind: np.ndarray
    order_group: np.ndarray
    judgements: Mapping[int, Judgement]
    seed: int
    spread: np.ndarray


def normalizing(place: np.ndarray) -> np.ndarray:
    """`(4, 4)` similarity after which places have mean 0 and a root mean square of 1."""
    known = place[np.isfinite(place).all(axis=1)]
    center = known.mean(axis=0)
    size = np.sqrt(((known - center) ** 2).sum(axis=1).mean())
    motion = np.eye(4)
    motion[:3, :3] /= size
    motion[:3, 3] = -center / size
    return motion


def moved_by_similarity(motion: np.ndarray, points: np.ndarray) -> np.ndarray:
    """`(n, 3)` points moved by a similarity."""
    return points @ motion[:3, :3].T + motion[:3, 3]


def directions(motion: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """`(n, 3)` unit vectors turned by a similarity."""
    turned = vectors @ motion[:3, :3].T
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def assembled(
    found: Found, *, joint_names: Sequence[str], num_rows: int, sensation: csr_array | None
) -> BodyModel:
    """The body model.

    Args:
        found: what the fit found.
        joint_names: `(J,)`.
        num_rows: R, all stored touches.
        sensation: `(R, S)` readings of the receptors; None: no receptor is placed.
    """
    tree, scene, solution = found.tree, found.scene, found.solution
    num_joints, num_parts = len(joint_names), int(scene.part.max()) + 1
    motion = normalizing(solution.place)
    twists, carried = for_readings(tree, solution.twists, found.center, found.scale, motion)
    parent = np.full(num_joints, UNUSED)
    for joint, above in tree.parent.items():
        parent[joint] = above
    part_link = np.full(num_parts, UNUSED)
    for part, link in tree.part.items():
        part_link[part] = link
    touchers = _touchers(found, carried)
    place, normal = _kernels(found, carried)
    skin = _receptors(found, carried, normal, place, sensation)
    covariance = _covariance(found, motion)
    variance = np.diag(covariance)[: twists.size]
    parts = range(num_parts)
    judged = [found.judgements.get(part) for part in parts]
    counts = np.bincount(scene.part[scene.target], minlength=num_parts)
    return BodyModel(
        joint_names=tuple(joint_names),
        joint_parent=parent,
        twists=twists,
        twist_sigma=np.sqrt(np.maximum(variance, 0.0)).reshape(twists.shape),
        covariance=covariance,
        joint_kind=found.kind,
        order_group=found.order_group,
        part_link=part_link,
        toucher_link=touchers.link,
        toucher_place=touchers.place,
        toucher_shape=touchers.shape,
        kernel_part=scene.part,
        kernel_place=place,
        kernel_normal=normal,
        kernel_toucher=_toucher_of_rows(found, num_rows),
        receptor_part=skin.part,
        receptor_place=skin.place,
        receptor_normal=skin.normal,
        receptor_sigma=skin.sigma,
        accepted_by_part=np.array([bool(j and j.accepted) for j in judged]),
        reason=reasons(judged),
        held_out=np.array([j.near if j else np.nan for j in judged]),
        inliers=np.array([j.inliers if j else np.nan for j in judged]),
        criterion=np.array([j.criterion if j else np.nan for j in judged]),
        num_touches=counts,
        dimension=dimension(scene, solution),
        seed=found.seed,
    )


class _Touchers(NamedTuple):
    """`(U,)` links, `(U, 3)` places and `(U, 5)` shapes of touchers, as in `BodyModel`."""

    link: np.ndarray
    place: np.ndarray
    shape: np.ndarray


def _touchers(found: Found, carried: Mapping[int, np.ndarray]) -> _Touchers:
    solution = found.solution
    links = [found.tree.toucher[number] for number in range(len(solution.points))]
    places = [
        moved_by_similarity(carried[link], point[None])[0]
        for link, point in zip(links, solution.points, strict=True)
    ]
    shapes = np.zeros((len(links), 5))
    if solution.sizes is not None:
        for number, link in enumerate(links):
            shapes[number] = shape_moved(carried[link], solution.sizes.shape[number])
    return _Touchers(np.array(links), np.array(places), shapes)


def _kernels(found: Found, carried: Mapping[int, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """`(K, 3)` places and outward normals of kernels; NaN for parts that the tree lacks."""
    scene, solution = found.scene, found.solution
    place, normal = np.full((len(scene.part), 3), np.nan), np.full((len(scene.part), 3), np.nan)
    outward = outward_normals(scene, solution)
    for part, link in found.tree.part.items():
        here = scene.part == part
        place[here] = moved_by_similarity(carried[link], solution.place[here])
        normal[here] = directions(carried[link], outward[here])
    return place, normal


def _toucher_of_rows(found: Found, num_rows: int) -> np.ndarray:
    """`(R,)` int8, the toucher that made each stored touch; -1 if none explains it."""
    scene, solution = found.scene, found.solution
    toucher = np.full(num_rows, -1, dtype=np.int8)
    nearest = nearest_toucher(
        solution_places(scene, solution), solution.place, scene.part, scene.target
    )
    toucher[found.rows] = np.where(solution.share.sum(axis=1) > 0.5, nearest, -1)
    return toucher


def reasons(judged: Sequence[Judgement | None]) -> str:
    """One sentence for each part."""
    texts = []
    for part, judgement in enumerate(judged):
        of_part = f"Part {part + 1} of {len(judged)}: " if len(judged) > 1 else ""
        if judgement is None:
            texts.append(f"{of_part}rejected: no place in the tree of joints was found for it.")
        else:
            verdict = "accepted" if judgement.accepted else "rejected"
            texts.append(f"{of_part}{verdict}: {judgement.reason}.")
    return " ".join(texts)


def dimension(scene: Scene, solution: Solution) -> int:
    """Dimensions in which kernels' places spread much more than touches of one kernel do."""
    spreads = []
    Y = solution_places(scene, solution)
    for part in scene.parts:
        rows = scene.rows(part)
        best = solution.share[rows].argmax(axis=1)
        y = Y[best, rows]
        kept = solution.share[rows].sum(axis=1) > 0.5
        r = (y - solution.place[scene.target[rows]])[kept]
        if len(r) < 8:
            continue
        tiny = 1e-9 * np.trace(np.cov(y[kept].T)) * np.eye(3)
        within, total = np.cov(r.T) + tiny, np.cov(y[kept].T) + tiny
        spreads.append(
            int((np.linalg.eigvals(np.linalg.solve(within, total)).real > _SPREAD).sum())
        )
    return max(spreads, default=0)


def _covariance(found: Found, motion: np.ndarray) -> np.ndarray:
    """`(6 J + 3 U, 6 J + 3 U)` as in `BodyModel`.

    The fit leaves the unit of length open, and the model takes it from the places of kernels: so
    what makes these places grow makes lengths shrink.
    """
    solution, spread = found.solution, found.spread
    rows = np.arange(len(found.scene.q))[:: 1 + len(found.scene.q) // _MEASURED]
    scene, share = found.scene.some(rows), solution.share[rows]
    base = _parameters(found, solution, motion)
    growth = _growth(scene, solution, share, len(spread))
    known = np.flatnonzero(np.isfinite(np.diag(spread))[: len(base)])
    is_length = np.arange(len(base)) % 6 > 2
    is_length[solution.twists.size :] = True
    slope = np.empty((len(base), len(known)))
    for column, entry in enumerate(known):
        step = np.zeros(len(spread))
        step[entry] = _STEP
        moved = moved_by(solution, step)
        slope[:, column] = (_parameters(found, moved, motion) - base) / _STEP
    slope -= np.outer(is_length * base, growth[known])
    covariance = slope @ spread[np.ix_(known, known)] @ slope.T
    out = [joint not in found.tree.parent for joint in range(len(solution.twists))]
    lost = np.flatnonzero(np.concatenate([np.repeat(out, 6), np.zeros(3 * len(solution.points))]))
    covariance[lost], covariance[:, lost] = np.nan, np.nan
    slides = np.flatnonzero(found.kind == JointKind.SLIDES)
    held = np.ravel(6 * slides[:, None] + np.arange(3))
    covariance[held], covariance[:, held] = 0.0, 0.0
    return covariance


def _parameters(found: Found, solution: Solution, motion: np.ndarray) -> np.ndarray:
    """`(6 J + 3 U,)` twists for raw readings, and the touchers' places in the frames of links."""
    twists, carried = for_readings(found.tree, solution.twists, found.center, found.scale, motion)
    points = [
        moved_by_similarity(carried[found.tree.toucher[number]], point[None])[0]
        for number, point in enumerate(solution.points)
    ]
    return np.concatenate([twists.ravel(), np.ravel(points)])


def _growth(scene: Scene, solution: Solution, share: np.ndarray, size: int) -> np.ndarray:
    """What each parameter adds to the logarithm of what `normalizing` makes 1.

    Args:
        scene: some touches.
        solution: of these and others.
        share: `(n, U)` who made them.
        size: of all parameters, in the order of `Equations`.
    """
    growth = np.zeros(size)
    kept, best = share.sum(axis=1) > 0.5, share.argmax(axis=1)
    pairs = []
    for part, toucher in scene.ways:
        rows = scene.rows(part)
        rows = rows[kept[rows] & (best[rows] == toucher)]
        if len(rows):
            pairs.append((rows, *place_slopes(scene, solution, rows, part, toucher)))
    if not pairs:
        return growth  # All touches are outliers.
    rows = np.concatenate([of_pair[0] for of_pair in pairs])
    places = np.concatenate([of_pair[1] for of_pair in pairs])
    number = len(scene.part)
    count = np.bincount(scene.target[rows], minlength=number)
    touched = count > 0
    place = np.zeros((number, 3))
    place[touched] = kernel_sums(places, scene.target[rows], number)[touched]
    place[touched] /= count[touched, None]
    away = np.where(touched[:, None], place - place[touched].mean(axis=0), 0.0)
    away /= np.square(away).sum() * np.maximum(count, 1)[:, None]
    for own, _, slope, columns in pairs:
        growth[columns] += np.einsum("na,nap->p", away[scene.target[own]], slope)
    return growth


def _receptors(
    found: Found,
    carried: Mapping[int, np.ndarray],
    normal: np.ndarray,
    kernel_place: np.ndarray,
    sensation: csr_array | None,
) -> Receptors:
    """Places of receptors in their part's frame, and their normals.

    They begin at the means of the touches that press them.
    """
    number = 0 if sensation is None else sensation.shape[1]
    part = np.full(number, -1)
    place, outward = np.full((number, 3), np.nan), np.full((number, 3), np.nan)
    sigma = np.full(number, np.nan)
    result = Receptors(place=place, normal=outward, sigma=sigma, part=part)
    if sensation is None or len(found.rows) == 0:
        return result
    scene, solution = found.scene, found.solution
    pressed = csr_array(sensation)[found.rows].tocoo()
    hardest = np.zeros(len(found.rows))
    np.maximum.at(hardest, pressed.row, pressed.data)
    kept = pressed.data >= _PRESSED * np.maximum(hardest[pressed.row], 1e-12)
    kept &= (pressed.data > 0) & (solution.share.sum(axis=1)[pressed.row] > 0.5)
    row, receptor, press = pressed.row[kept], pressed.col[kept], pressed.data[kept]
    Y = solution_places(scene, solution)
    y = Y[solution.share.argmax(axis=1), np.arange(len(scene.q))]
    of_part = scene.part[scene.target]
    weight = (press / hardest[row]) ** 2
    votes = np.zeros((number, int(scene.part.max()) + 1))
    np.add.at(votes, (receptor, of_part[row]), weight)
    met = votes.sum(axis=1) > 0
    part[met] = votes[met].argmax(axis=1)
    own = (of_part[row] == part[receptor]) & np.isfinite(y[row]).all(axis=1)
    row, receptor, weight = row[own], receptor[own], weight[own]
    mass = np.bincount(receptor, weights=weight, minlength=number)
    squares = np.bincount(receptor, weights=weight**2, minlength=number)
    has = mass > 0
    for axis in range(3):
        sums = np.bincount(receptor, weights=weight * y[row, axis], minlength=number)
        place[has, axis] = sums[has] / mass[has]
    spread = np.bincount(
        receptor, weights=weight * ((y[row] - place[receptor]) ** 2).sum(axis=1), minlength=number
    )
    sigma[has] = np.sqrt(spread[has] / mass[has] * squares[has] / mass[has] ** 2)
    kept = (solution.share.sum(axis=1) > 0.5) & np.isfinite(y).all(axis=1)
    felt = csr_array(sensation)[found.rows]
    for number_of_part in found.tree.part:
        own = np.flatnonzero(part == number_of_part)
        here = np.flatnonzero((of_part == number_of_part) & kept)
        place[own], error = middles_of_fields(y[here], felt[here][:, own], place[own])
        sigma[own] = np.where(np.isnan(error), sigma[own], error)
    sigma *= np.cbrt(abs(np.linalg.det(carried[BASE][:3, :3])))
    part[~has] = -1
    for number_of_part, link in found.tree.part.items():
        here = part == number_of_part
        place[here] = moved_by_similarity(carried[link], place[here])
        kernels = np.flatnonzero((scene.part == number_of_part) & np.isfinite(normal).all(axis=1))
        if len(kernels) and here.any():
            apart = np.linalg.norm(place[here][:, None] - kernel_place[kernels][None], axis=2)
            outward[here] = normal[kernels[apart.argmin(axis=1)]]
    place[~has] = np.nan
    return result
