"""Part of `rivals.py`: maps that no package here makes, and kinematics that are known.

`diffusion` are diffusion maps (Coifman and Lafon 2006); `variational` is a variational autoencoder
(Kingma and Welling 2014) with three latent units; `along_map` are plans over any map;
`calibrated_places` are what calibration by self-touch (Roncone et al. 2014) gives at best: places
of touches by the robot's own model, without an error left.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.bodies.embodiment import build_world
from selftouch_drake.experiment import load_experiment

# Of the variational autoencoder: rate and weight of the prior did best on seed 3 of `cube`.
_HIDDEN, _LATENT, _BATCH, _EPOCHS, _RATE, _PRIOR_WEIGHT = 128, 3, 100, 200, 3e-3, 0.03
# Links of each target to others in plans over a map.
_NEIGHBOURS_ON_MAP = 8
# The neighbour whose distance is the width of the kernel of diffusion maps.
_NEIGHBOUR = 10


def diffusion(felt: np.ndarray, seed: int) -> np.ndarray:
    """`(n, 3)` the first diffusion coordinates of `(n, S)` sensations, density taken out."""
    apart = cdist(felt, felt)
    near = np.sort(apart, axis=1)[:, min(_NEIGHBOUR, len(felt) - 1)]
    weight = np.exp(-np.square(apart) / np.median(near) ** 2)
    density = weight.sum(axis=1)
    weight /= np.outer(density, density)
    degree = np.sqrt(weight.sum(axis=1))
    last = len(felt) - 1
    value, vector = eigh(weight / np.outer(degree, degree), subset_by_index=[last - 3, last])
    # The largest eigenvalue, of the constant, is left out.
    return (vector / degree[:, None])[:, 2::-1] * value[2::-1]


def variational(felt: np.ndarray, seed: int) -> np.ndarray:
    """`(n, 3)` latent means of `(n, S)` sensations."""
    rng = np.random.default_rng(seed)
    num = felt.shape[1]
    layers = {"in": (num, _HIDDEN), "mean": (_HIDDEN, _LATENT), "log": (_HIDDEN, _LATENT),
              "up": (_LATENT, _HIDDEN), "out": (_HIDDEN, num)}  # fmt: skip
    weights = {
        name + kind: rng.normal(size=size) / np.sqrt(shape[0]) if kind == "_w" else np.zeros(size)
        for name, shape in layers.items()
        for kind, size in (("_w", shape), ("_b", shape[1:]))
    }
    weights["log_w"] *= 0.1
    first = {name: np.zeros_like(value) for name, value in weights.items()}
    second = {name: np.zeros_like(value) for name, value in weights.items()}
    step = 0
    for _ in range(_EPOCHS):
        for batch in np.array_split(rng.permutation(len(felt)), max(1, len(felt) // _BATCH)):
            step += 1
            noise = rng.normal(size=(len(batch), _LATENT))
            for name, slope in _slopes(weights, felt[batch], noise).items():
                first[name] += 0.1 * (slope - first[name])
                second[name] += 0.001 * (np.square(slope) - second[name])
                mean, square = first[name] / (1 - 0.9**step), second[name] / (1 - 0.999**step)
                weights[name] -= _RATE * mean / (np.sqrt(square) + 1e-8)
    return np.tanh(felt @ weights["in_w"] + weights["in_b"]) @ weights["mean_w"] + weights["mean_b"]


def _slopes(
    weights: Mapping[str, np.ndarray], felt: np.ndarray, noise: np.ndarray
) -> dict[str, np.ndarray]:
    """The gradient of the negative evidence bound, a mean over `(n, S)` sensations."""
    hidden = np.tanh(felt @ weights["in_w"] + weights["in_b"])
    mean = hidden @ weights["mean_w"] + weights["mean_b"]
    log = (hidden @ weights["log_w"] + weights["log_b"]).clip(-10.0, 10.0)
    spread = np.exp(0.5 * log)
    latent = mean + spread * noise
    upper = np.tanh(latent @ weights["up_w"] + weights["up_b"])
    off = (upper @ weights["out_w"] + weights["out_b"] - felt) / len(felt)
    d_upper = off @ weights["out_w"].T * (1 - upper**2)
    d_latent = d_upper @ weights["up_w"].T
    d_mean = d_latent + _PRIOR_WEIGHT * mean / len(felt)
    d_log = 0.5 * d_latent * spread * noise + 0.5 * _PRIOR_WEIGHT * (np.exp(log) - 1) / len(felt)
    d_hidden = (d_mean @ weights["mean_w"].T + d_log @ weights["log_w"].T) * (1 - hidden**2)
    pairs = {"in": (felt, d_hidden), "mean": (hidden, d_mean), "log": (hidden, d_log),
             "up": (latent, d_upper), "out": (upper, off)}  # fmt: skip
    found = {f"{name}_w": below.T @ above for name, (below, above) in pairs.items()}
    return found | {f"{name}_b": above.sum(axis=0) for name, (_, above) in pairs.items()}


def along_map(
    representation: QuotientRepresentation, places: np.ndarray, start: np.ndarray, ends: np.ndarray
) -> np.ndarray:
    """`(W, J)` a plan over a map of target sensations: the shortest way between neighbours on it.

    In each target on the way it takes the stored posture nearest to the one before. Where the map
    has no way, the plan goes straight to the goal.

    Args:
        representation: whose targets are laid out.
        places: `(K, 3)` where the map has them.
        start: `(J,)` rad or m, where the plan begins.
        ends: `(2,)` the targets that are felt at the start and at the goal.
    """
    num = len(places)
    away, near = cKDTree(places).query(places, min(_NEIGHBOURS_ON_MAP + 1, num))
    # A way of no length would be none.
    lengths = np.maximum(away[:, 1:], 1e-9).ravel()
    from_to = np.repeat(np.arange(num), near.shape[1] - 1), near[:, 1:].ravel()
    links = csr_array((lengths, from_to), shape=(num, num))
    before = dijkstra(links, directed=False, indices=int(ends[0]), return_predecessors=True)[1]
    way = [int(ends[1])]
    while way[-1] != ends[0] and before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    if way[-1] != ends[0]:
        way = way[:1]
    offsets, scale = representation.kernel_offsets, np.std(representation.kernel_q, axis=0)
    found = [start]
    for target in way[::-1]:
        stored = representation.kernel_q[offsets[target] : offsets[target + 1]].astype(float)
        off = np.square((stored - found[-1]) / np.maximum(scale, 1e-9)).sum(axis=1)
        found.append(stored[off.argmin()])
    return np.array(found)


def calibrated_places(
    truth: Mapping[str, np.ndarray], q: np.ndarray, rows: np.ndarray
) -> dict[str, np.ndarray]:
    """A hand-in of touches' places by the robot's own model, in the frames of the touched links.

    What no calibration knows by itself is given to it: which link was touched, and, of several
    touchers, the one that did it.

    Args:
        truth: of the recording, as `benchmarks/make/recordings.py` has it.
        q: `(n, J)` rad or m, joint positions of touches.
        rows: `(n,)` the numbers of these touches in the recording.
    """
    known = truth["cell"][rows] >= 0
    rows, q = rows[known], q[known].astype(float)
    cell = truth["cell"][rows]
    experiment = load_experiment(str(truth["experiment"]), {"seed": int(truth["seed"])})
    robot = build_world(experiment).robot
    skin = truth["cell_skin"][cell]
    X_WL = robot.skin_positions(q)[np.arange(len(q)), skin]
    p_WT = robot.toucher_positions(q)
    p_LT = np.einsum("nji,nuj->nui", X_WL[:, :, :3], p_WT - X_WL[:, None, :, 3])
    off = np.linalg.norm(p_LT - truth["touch_places"][rows][:, None], axis=2)
    places = p_LT[np.arange(len(q)), off.argmin(axis=1)]
    part = truth["cell_part"][cell]
    return {"touch_places": places, "rows": rows, "parts": np.where(part < 0, -1, part).astype(int)}
