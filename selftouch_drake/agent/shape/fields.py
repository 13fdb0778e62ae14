"""Lengths of edges from sensations, corrected for where the receptors lie.

The angle between the sensations of two neighbours depends on their distance, but also on the
receptors around: where these are dense, missing or badly placed, the same step feels longer or
shorter. So the agent models its skin. It supposes that all receptors are alike, and that each feels
less the farther along the body a touch is. From a layout it finds the place of each receptor and
the curve by which its reading falls with distance. What the model would feel on a step in the
layout, beside what the agent felt, says how long the step is.

A layout from better lengths gives a better model. Errors of the first layout nearly vanish in two
rounds.
"""

import numpy as np
from scipy.optimize import isotonic_regression

from selftouch_drake.quotient.layout import Majoriser, stress_embedding, unbent
from selftouch_drake.quotient.paths import geodesics
from selftouch_drake.quotient.sensations import angles

#: Rounds of layout and model. More change lengths by less than 2 %.
_ROUNDS = 2

#: Iterations of the first layout, and those that straighten a layout in each round. To the end,
#: they take 2.5 times as long; errors change by less than 0.03 percentage points.
_FIRST_LAYOUT = {"num_trial_iterations": 15, "num_iterations": 40}
_NUM_ITERATIONS = 20

#: Steps in which receptors are placed and the curve is fitted, in each round.
_NUM_STEPS = 4

#: Readings of unit sensations below this are too weak to tell a distance.
_LEAST_READING = 0.02

#: Readings between which a distance is well known: not at the top, nor at the foot of the curve.
_STEEP = (0.05, 0.75)

#: Points of the curve.
_NUM_BINS = 60

#: Largest correction of a length.
_MOST_CORRECTED = 2.0

#: Share of the readings' squares that a model must explain.
_LEAST_EXPLAINED = 0.9


def corrected_lengths(
    targets: np.ndarray,
    kernel: np.ndarray,
    edges: np.ndarray,
    length: np.ndarray,
    skin: int = 2,
) -> np.ndarray | None:
    """Lengths of edges that explain the angles between the sensations of their ends.

    The first estimate of the lengths, `(E,)`, is positive; `(E, 2)` edges connect all nodes; `(N,)`
    is the kernel of each node, and a kernel may have several nodes; `(K, S)` targets have unit L2
    norm; the skin has 1 or 2 dimensions. None where the model does not explain what is felt.
    """
    # Pieces of one kernel share its sensation, which belongs to none of their places.
    whole = np.bincount(kernel)[kernel] == 1
    readings = targets[kernel]
    readings = readings[:, (readings * whole[:, None]).max(axis=0) > _LEAST_READING]
    if not readings.size:
        return None
    felt = angles(readings, edges)
    inside = kernel[edges[:, 0]] == kernel[edges[:, 1]]
    positions = None
    for _ in range(_ROUNDS):
        along = geodesics(edges, length, len(kernel))
        majoriser = Majoriser(along)
        if positions is None:
            first = stress_embedding(along, skin + 1, **_FIRST_LAYOUT, majoriser=majoriser)
            positions = first.positions
        positions, _ = unbent(positions, edges, along, majoriser, _NUM_ITERATIONS)
        model = _model(readings, whole, positions, edges, skin)
        if model is None:
            return None
        modelled = angles(model, edges)
        laid = _steps(positions, edges)
        ratio = np.divide(felt, modelled, out=np.ones_like(felt), where=~inside & (modelled > 0))
        length = laid * np.clip(ratio, 1.0 / _MOST_CORRECTED, _MOST_CORRECTED)
    return length


def _falling_curve(reading: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How readings fall with distance along the body: fits readings, ascending, and distances."""
    order = np.argsort(reading)
    bins = np.array_split(order, min(_NUM_BINS, len(order)))
    mean = np.array([[reading[rows].mean(), distance[rows].mean()] for rows in bins])
    return mean[:, 0], isotonic_regression(mean[:, 1], increasing=False).x


def _reading_at(distance: np.ndarray, curve: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    return np.interp(distance, curve[1][::-1], curve[0][::-1], right=0.0)


def _model(
    readings: np.ndarray,
    whole: np.ndarray,
    positions: np.ndarray,
    edges: np.ndarray,
    skin: int,
) -> np.ndarray | None:
    """`(N, S)` what receptors that are all alike would feel at nodes, unit L2 norm.

    They felt `(N, S)` readings; `whole` is `(N,)` nodes at whose place that was felt. The nodes are
    at `(N, skin + 1)` positions, with `(E, 2)` edges. None if that explains too little.
    """
    at_place = np.where(whole[:, None], readings, 0.0)
    node, receptor = np.nonzero(at_place > _LEAST_READING)
    reading = at_place[node, receptor]
    # A receptor lies near the node where it feels most, in the tangent plane of the skin there.
    nearest = at_place.argmax(axis=0)
    near = np.eye(len(positions))
    near[edges[:, 0], edges[:, 1]] = near[edges[:, 1], edges[:, 0]] = 1.0
    rings = near @ near > 0
    around = [positions[rings[node]] for node in nearest]
    plane = np.array(
        [np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][:skin].T for p in around]
    )
    weight = at_place**3
    place = (weight.T @ positions) / weight.sum(axis=0)[:, None] - positions[nearest]
    place = positions[nearest] + np.einsum("sdt,set,se->sd", plane, plane, place)
    # Distances along the body, over steps to two rings: they turn less than steps to one.
    steps = np.argwhere(np.triu(rings, 1))
    length = _steps(positions, steps)
    along = geodesics(steps, length, len(positions))[:, nearest]
    straight = np.linalg.norm(positions[:, None] - positions[nearest], axis=2)
    far = straight > np.median(length) / 2
    bent = np.divide(along, straight, out=np.ones_like(along), where=far)
    strength = np.ones(len(positions))
    steep = (reading > _STEEP[0]) & (reading < _STEEP[1])
    for _ in range(_NUM_STEPS):
        offset = positions[node] - place[receptor]
        distance = np.linalg.norm(offset, axis=1) * bent[node, receptor]
        for _ in range(3):
            curve = _falling_curve(reading / strength[node], distance)
            # Sensations have unit norm: their readings are strong where few receptors feel.
            modelled = _reading_at(distance, curve)
            both = np.bincount(node, reading * modelled, len(whole))
            squared = np.bincount(node, modelled * modelled, len(whole))
            known = whole & (squared > 0)
            strength = np.divide(both, squared, out=np.ones_like(both), where=known)
            strength /= np.median(strength[whole])
        # Moves each receptor in its plane until distances fit its readings (Gauss-Newton).
        toward = np.einsum("rdt,rd->rt", plane[receptor], -offset)
        toward /= np.maximum(np.linalg.norm(toward, axis=1), 1e-9)[:, None]
        missing = np.interp(reading / strength[node], *curve) - distance
        normal = np.zeros((len(place), skin, skin))
        pull = np.zeros((len(place), skin))
        np.add.at(normal, receptor[steep], toward[steep, :, None] * toward[steep, None])
        np.add.at(pull, receptor[steep], toward[steep] * missing[steep, None])
        step = np.linalg.solve(normal + 1e-6 * np.eye(skin), pull[..., None])[..., 0]
        place += np.einsum("sdt,st->sd", plane, step)
    apart = np.linalg.norm(positions[:, None] - place, axis=2) * bent
    model = _reading_at(apart, curve)
    model /= np.maximum(np.linalg.norm(model, axis=1), 1e-12)[:, None]
    wrong = np.square(at_place - model)[whole].sum() / np.square(at_place).sum()
    return model if wrong < 1.0 - _LEAST_EXPLAINED else None


def _steps(positions: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """`(E,)` distances between the rows of `(E, 2)` pairs."""
    return np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
