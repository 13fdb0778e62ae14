"""Where a search begins: bodies at random, a limb as another one's mirror image, skins unfolded."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.both_sides.problem import Body, Population, Problem
from selftouch_drake.agent.shape.alignment import align

# Spread of random centres, of points on the trunk, and of what begins as a mirror image, in
# diameters of a contact.
_CENTRES, _AWAY, _BESIDE = 2.0, 2.0, 0.3
# Ridge of the coefficients of a first map, relative to the number of receptors.
_RIDGE = 2e-4
# Share of mirror images that are drawn without what touches say of them, and how far their plane
# is off otherwise.
_UNTOLD, _TILT = 0.25, 0.15
# Receptors felt more often than this keep the place that a fit gave them.
_PLACED = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image:
    """What touches say of a limb as the mirror image of another one, before any body is known.

    Attributes:
        sense: `(J,)` by column of the readings: 1 if it and its counterpart have one range, -1 if
            one has the mirror image of the other's.
        sides: by skin of the trunk, `(n,)` weights of its receptors: those that the second limb
            touches less those that the first one does. Both sums are 1.
    """

    sense: np.ndarray
    sides: Mapping[str, np.ndarray]

    def normal(self, body: Body, rows: np.ndarray) -> np.ndarray:
        """`(B, 3)` from what the first limb touches to what the second one does; 0 if unknown."""
        across = np.zeros((len(rows), 3))
        for end, weight in self.sides.items():
            own = body.coefficients(rows, end).astype(float)
            across += (weight @ body.skins[end].basis) @ own
        return across


def at_random(body: Body, number: int, random: np.random.Generator) -> np.ndarray:
    """`(number, P)` bodies: axes and centres at random, skins as unfolded, turned and mirrored.

    Args:
        body: its skins and layout.
        number: of bodies.
        random: source of randomness.
    """
    rows = np.empty((number, body.length), dtype=np.float32)
    body.axes(rows)[:] = _unit(random.normal(size=(number, body.num_joints, 3)))
    body.centres(rows)[:] = _CENTRES * random.normal(size=(number, body.num_joints, 3))
    for end in body.ends:
        scatter_end(body, rows, end, random)
    return rows


def scatter_end(body: Body, rows: np.ndarray, end: str, random: np.random.Generator) -> None:
    """Gives an end of all rows a random place; a skin is also turned and mirrored at random."""
    on_trunk = not body.layout.holder[end]
    own = body.coefficients(rows, end)
    if end in body.skins:
        own[:] = first_coefficients(body, end) @ any_turns(len(rows), random)
    own[:, 0] = _AWAY * random.normal(size=(len(rows), 3)) * (not on_trunk)


def first_coefficients(body: Body, skin: str) -> np.ndarray:
    """`(K, 3)` coefficients of a skin's first map."""
    own = body.skins[skin]
    known = np.isfinite(own.first[:, 0])
    return _fitted(own.basis, own.first, known.astype(float))


def any_turns(number: int, random: np.random.Generator) -> np.ndarray:
    """`(number, 3, 3)` rotations and reflections at random."""
    q, r = np.linalg.qr(random.normal(size=(number, 3, 3)))
    return q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]


def mirrored(
    body: Body,
    parents: Population,
    limb: tuple[str, str],
    each: int,
    random: np.random.Generator,
    image: Image | None = None,
) -> tuple[Population, np.ndarray]:
    """Bodies whose second limb is the mirror image of the first in a plane through the trunk.

    The plane and the senses of the axes are those that touches tell, and drawn for some bodies:
    limbs need not be moved alike.

    Args:
        body: its skins and layout.
        parents: bodies whose first limb is known.
        limb: names of the first limb and the second.
        each: mirror images of each parent.
        random: source of randomness.
        image: what touches say of it.

    Returns:
        The bodies, and `(B,)` the index of each one's parent.
    """
    layout = body.layout
    known, new = (list(layout.limbs[name]) for name in limb)
    parent = np.repeat(np.arange(len(parents.rows)), each)
    rows, before = parents.rows[parent].copy(), parents.rows[parent]
    middle = trunk_middle(body, rows)
    normal = _unit(random.normal(size=(len(rows), 3)))
    sense = np.where(random.random((len(rows), len(new))) < 0.5, -1, 1)
    if image is not None:
        told = random.random((len(rows), 1)) >= _UNTOLD
        # What turns one way turns the other way in a mirror.
        sense = np.where(told, -image.sense[parents.orders[parent][:, new]], sense)
        across = image.normal(body, rows)
        if across.any():
            tilted = _unit(_unit(across) + _TILT * random.normal(size=across.shape))
            normal = np.where(told, tilted, normal)
    plane = np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]

    def mirror(point: np.ndarray) -> np.ndarray:
        return (point - middle[:, None]) @ plane + middle[:, None]

    body.axes(rows)[:, new] = body.axes(before)[:, known] @ plane * sense[:, :, None]
    beside = _BESIDE * random.normal(size=(len(rows), len(new), 3))
    body.centres(rows)[:, new] = mirror(body.centres(before)[:, known]) + beside
    held = [end for end in body.ends if layout.holder[end] == limb[0]]
    middles: dict[bool, list[np.ndarray]] = {}
    for end in held:
        middles.setdefault(end in body.skins, []).append(_middle(body, before, end))
    for end in [end for end in body.ends if layout.holder[end] == limb[1]]:
        scatter_end(body, rows, end, random)
        there = np.mean(middles.get(end in body.skins, next(iter(middles.values()))), axis=0)
        body.coefficients(rows, end)[:, 0] = mirror(there[:, None])[:, 0]
    nothing = np.full(len(rows), np.nan)
    orders = parents.orders[parent].copy()
    return Population(rows=rows, orders=orders, loss=nothing), parent


def unfolded(problem: Problem, rows: np.ndarray) -> np.ndarray:
    """Rows whose receptors that the recordings never felt lie where the first map continues.

    Args:
        problem: whose recordings placed the rest.
        rows: `(B, P)` bodies.
    """
    body, rows = problem.body, rows.copy()
    for name, skin in body.skins.items():
        felt = sum(
            own[:, skin.receptor].sum(axis=0)
            for one in problem.recordings
            if (own := one.felt(name)) is not None
        )
        if np.ndim(felt) == 0:
            continue
        mapped, placed = np.isfinite(skin.first[:, 0]), felt > _PLACED
        both = mapped & placed
        if both.sum() < 8 or placed.all():
            continue
        weight = np.where(placed, 1.0, 0.5 * mapped)
        for row in rows:
            place = body.places(row, name)
            moved = np.full_like(place, 0)
            moved[mapped] = align(skin.first[both], place[both], skin.first[mapped])
            target = np.where(placed[:, None], place, moved)
            ridge = 0.3 / len(weight)
            body.coefficients(row, name)[:] = _fitted(skin.basis, target, weight, ridge)
    return rows


def trunk_middle(body: Body, rows: np.ndarray) -> np.ndarray:
    """`(B, 3)` middle of what the trunk carries; 0 if it carries nothing."""
    ends = [end for end in body.skins if not body.layout.holder[end]]
    if not ends:
        return np.zeros((len(rows), 3))
    return np.mean([_middle(body, rows, end) for end in ends], axis=0)


def _middle(body: Body, rows: np.ndarray, end: str) -> np.ndarray:
    own = body.coefficients(rows, end).astype(float)
    return body.skins[end].basis.mean(axis=0) @ own if end in body.skins else own[:, 0]


def _fitted(
    basis: np.ndarray, place: np.ndarray, weight: np.ndarray, ridge: float = _RIDGE
) -> np.ndarray:
    weighted = basis * weight[:, None]
    damped = weighted.T @ basis + ridge * len(basis) * np.eye(basis.shape[1])
    return np.linalg.solve(damped, weighted.T @ np.nan_to_num(place))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
