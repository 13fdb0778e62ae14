"""Learns a smooth map from motor space to the quotient space (paper, section II, figure 1).

By the theorem, motor configurations become the surface of the body if those that feel alike are
identified. So there is a smooth function of the motor configuration that is constant on every
motor kernel set and differs between them. A small network learns one: its outputs should vary
little within kernels and much across them. It receives motor configurations and the kernel of each;
it does not know that joints turn.

On some bodies, and with many joints, most networks fold: they map two distant places to the same
outputs. A network that is first trained to predict sensations seldom folds. Where neither folds,
the one without this training is slightly more accurate.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh

from selftouch_drake.agent.network import Network, standardised, toward, train
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.threads import in_slices

#: Three hidden layers of 128, 16 outputs. With 10 outputs some networks fold the torus: they learn
#: finer waves around its ring, and do not separate its top from its bottom.
_HIDDEN = (128, 128, 128)
_NUM_OUTPUTS = 16

#: Training steps, on 512 pairs of configurations each; more do not change the shape error. With 450
#: steps, both networks folded for one of three seeds on a torus; with 600 for none of five.
_NUM_PAIRS = 512
_NUM_STEPS = 600

#: Share of the steps in which the network learns to predict sensations, if it does.
_EXPECTING = 0.25

#: Pairs from which the output layer is initialised.
_NUM_FIRST_PAIRS = 8192

#: Directions with more than this share of their variance within kernels are noise.
_MOST_WITHIN = 0.1
_LEAST_DIRECTIONS = 3

#: Rounding error of the scatter in single (4 bytes) and double precision, over its mean variance.
_FLOOR = {4: 1e-5, 8: 1e-11}

#: Configurations of each kernel that are mapped, from which the width of its cell is measured.
_MOST_MAPPED = 250

# Rows that one thread works on at once: large arrays are slow to get from the system.
_ROWS = 16_384


def quotient_coordinates(
    sets: KernelSets,
    *,
    seed: int,
    target_sensations: np.ndarray | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> KernelSets:
    """Learns the quotient map and applies it to the motor configurations, scaled or not.

    The network first learns to predict `(K, S)` targets, if given. The same seed gives the same
    bytes, on one machine. Returns some configurations of each set in `(n, D)` quotient coordinates,
    3 to 16, each of unit variance across all kernels, those that vary least within kernels first.

    Raises:
        ValueError: no kernel holds two configurations, so nothing shows what must be constant.
    """
    sizes = sets.sizes
    if sizes.max() < 2:
        raise ValueError(
            "kernel_q holds one configuration per kernel: the learned metric needs several; "
            "babble longer, or ask for fewer targets"
        )
    rng = np.random.default_rng(seed)
    x = standardised(sets.x)

    def pairs(count: int) -> np.ndarray:
        """One configuration of each pair in the first half, its partner in the second."""
        kernel = rng.integers(len(sizes), size=count)
        members = sets.offsets[kernel] + (rng.random((2, count)) * sizes[kernel]).astype(int)
        return members.ravel()

    network = Network.random([x.shape[1], *_HIDDEN, _NUM_OUTPUTS], rng)
    expecting = 0
    if target_sensations is not None:
        # Sensations become a linear function of the hidden layers.
        expecting = round(_EXPECTING * _NUM_STEPS)
        wanted = target_sensations - np.average(target_sensations, axis=0, weights=sizes)
        spread = np.sqrt(np.average(np.square(wanted).sum(axis=1), weights=sizes))
        out = Network.random([_HIDDEN[-1], wanted.shape[1]], rng)
        hidden = network.weights[:-1], network.biases[:-1]
        train(
            Network(weights=hidden[0] + out.weights, biases=hidden[1] + out.biases),
            x,
            lambda: rng.integers(len(x), size=2 * _NUM_PAIRS),
            toward((wanted / spread).astype(np.float32), sets.kernel),
            expecting,
            lambda fraction: progress(_EXPECTING * fraction),
        )
    # The best linear outputs of the hidden layers cover the whole body, if weakly; random outputs
    # may not.
    _, layers, _ = network.forward(x[pairs(_NUM_FIRST_PAIRS)])
    network.weights[-1][:] = eigh(*_scatters(layers[-1].astype(float)))[1][:, :_NUM_OUTPUTS]
    train(
        network,
        x,
        lambda: pairs(_NUM_PAIRS),
        lambda outputs, _: scatter_loss(outputs)[1].astype(np.float32),
        _NUM_STEPS - expecting,
        lambda share: progress((expecting + (_NUM_STEPS - expecting) * share) / _NUM_STEPS),
    )
    few = sets.at(x).thinned(_MOST_MAPPED)
    return discriminants(few.at(network(few.x)))


def scatter_loss(outputs: np.ndarray) -> tuple[float, np.ndarray]:
    """Scatter within kernels against total scatter: `log det S_w - log det S_t`, and its gradient.

    All directions count alike, so the network gains as much from a finer wave on the body as from
    a coarser one. A small share of the mean variance is added to both as a floor: without it, one
    direction that is constant everywhere would win. Outputs and gradient are `(2 n, D)`; rows i and
    n + i are a pair, of one kernel. For the gradient, the floor is held fixed.
    """
    half = len(outputs) // 2
    y = outputs.astype(float)
    within, total = _scatters(y)
    apart, centred = y[:half] - y[half:], y - y.mean(axis=0)
    loss = np.linalg.slogdet(within)[1] - np.linalg.slogdet(total)[1]
    slope = centred @ (np.linalg.inv(total) / -half)
    pull = apart @ (np.linalg.inv(within) / half)
    slope[:half] += pull
    slope[half:] -= pull
    return float(loss), slope


def _scatters(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(D, D)` scatter within pairs and in total, each plus its floor."""
    half = len(y) // 2
    apart, centred = y[:half] - y[half:], y - y.mean(axis=0)
    within, total = apart.T @ apart / (2 * half), centred.T @ centred / (2 * half)
    floor = np.trace(total) / len(total) * np.eye(len(total))
    return within + 1e-5 * floor, total + 1e-4 * floor


def discriminants(sets: KernelSets) -> KernelSets:
    """Linear discriminants: rotates and scales K sets of outputs, and drops the noisy directions.

    The sets have unit variance then, all kernels weighted alike.
    """
    outputs, sizes, kernel = sets.x, sets.sizes, sets.kernel
    mean = np.add.reduceat(outputs, sets.offsets[:-1], dtype=float) / sizes[:, None]
    near = mean.astype(outputs.dtype)
    weight = np.sqrt(1.0 / sizes / len(sizes)).astype(outputs.dtype)
    apart = np.empty_like(outputs)

    def centre(rows: slice) -> None:
        np.subtract(outputs[rows], near[kernel[rows]], out=apart[rows])
        apart[rows] *= weight[kernel[rows], None]

    in_slices(centre, len(outputs), _ROWS)
    within = (apart.T @ apart).astype(float)
    total = within + np.cov(mean.T, bias=True)
    floor = _FLOOR[outputs.dtype.itemsize] * np.trace(total) / len(total) * np.eye(len(total))
    share, directions = eigh(within + floor, total + floor)
    kept = max(int(np.sum(share < _MOST_WITHIN)), _LEAST_DIRECTIONS)
    directions = directions[:, :kept]
    found, middle = np.empty((len(outputs), directions.shape[1])), mean.mean(axis=0)

    def turn(rows: slice) -> None:
        np.matmul(outputs[rows] - middle, directions, out=found[rows])

    in_slices(turn, len(outputs), _ROWS)
    return sets.at(found)
