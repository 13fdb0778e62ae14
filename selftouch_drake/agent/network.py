"""A small smooth network with sine activations and hand-written gradients, in plain numpy."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from selftouch_drake.quotient.threads import in_slices, thread_pool

#: Initial learning rates: of hidden layers, whose steps are orthogonal, and of all other weights.
#: Measured on torus, cube and sphere: half or twice either rate gives a higher loss.
_HIDDEN_RATE, _OTHER_RATE = 0.05, 0.01

#: Share of the training over which the learning rate rises; afterwards it falls as a cosine.
_WARM_UP = 0.05

#: Standard deviation of initial hidden weights, relative to the one that preserves the variance.
_GAIN = 0.7

# Momentum of hidden layers; decay of the first and second moments of all other weights.
_MOMENTUM, _FIRST, _SECOND = 0.95, 0.9, 0.99

# Rows per evaluation of a network: a layer of so many stays in the cache of a core.
_CHUNK = 1024


def standardised(x: np.ndarray) -> np.ndarray:
    """`(n, inputs)` float32, with mean 0 and standard deviation 1 in each column."""
    deviation = x.std(axis=0)
    scale = np.where(deviation > 0, deviation, 1.0)
    return ((x - x.mean(axis=0)) / scale).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Network:
    """Layers `sin(x W + b)`, the last one without the sine.

    Attributes:
        weights: `(inputs, outputs)` float32 of each layer.
        biases: `(outputs,)` float32 of each layer.
    """

    weights: list[np.ndarray]
    biases: list[np.ndarray]

    @classmethod
    def random(
        cls, sizes: Sequence[int], rng: np.random.Generator, *, gain: float = _GAIN
    ) -> "Network":
        """An untrained network; its layers have these sizes, inputs first; for gain see `_GAIN`."""
        spread = [1.0] + [gain * np.sqrt(2.0 / size) for size in sizes[1:-1]]
        weights = [
            (scale * rng.standard_normal(shape)).astype(np.float32)
            for scale, shape in zip(spread, pairwise(sizes), strict=True)
        ]
        phases = [rng.uniform(-np.pi, np.pi, size).astype(np.float32) for size in sizes[1:-1]]
        return cls(weights=weights, biases=[*phases, np.zeros(sizes[-1], np.float32)])

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Maps `(n, inputs)` to `(n, outputs)`, in chunks that bound the memory."""
        outputs = np.empty((len(x), len(self.biases[-1])), np.result_type(x, np.float32))

        def fill(rows: slice) -> None:
            inner = x[rows]
            for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
                inner = inner @ weight
                inner += bias
                np.sin(inner, out=inner)
            outputs[rows] = inner @ self.weights[-1] + self.biases[-1]

        in_slices(fill, len(x), _CHUNK)
        return outputs

    def forward(self, x: np.ndarray) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
        """Returns the outputs, and the inputs and slopes of the layers for `gradients`."""
        inputs, slopes = [x], []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            angle = inputs[-1] @ weight
            angle += bias
            slopes.append(np.cos(angle))
            inputs.append(np.sin(angle, out=angle))
        return inputs[-1] @ self.weights[-1] + self.biases[-1], inputs, slopes

    def gradients(
        self, slope: np.ndarray, inputs: list[np.ndarray], slopes: list[np.ndarray]
    ) -> list[np.ndarray]:
        """Backpropagates the gradient of a loss in the outputs to `[*weights, *biases]`."""
        of_weights: list[np.ndarray] = []
        of_biases: list[np.ndarray] = []
        for layer in reversed(range(len(self.weights))):
            of_weights.insert(0, inputs[layer].T @ slope)
            of_biases.insert(0, slope.sum(axis=0))
            if layer:
                slope = slope @ self.weights[layer].T
                slope *= slopes[layer - 1]
        return of_weights + of_biases

    def slope_of_inputs(self, slope: np.ndarray, slopes: list[np.ndarray]) -> np.ndarray:
        """Carries the slope of a loss in the outputs back to the inputs, `(n, inputs)`."""
        for weight, inner in zip(self.weights[:0:-1], slopes[::-1], strict=True):
            slope = (slope @ weight.T) * inner
        return slope @ self.weights[0].T


# Each of two threads has its own half of a batch: threads of the library would come on top.
@threadpool_limits.wrap(limits=1, user_api="blas")
def train(
    network: "Network",
    x: np.ndarray,
    draw: Callable[[], np.ndarray],
    loss_slope: Callable[[np.ndarray, np.ndarray], np.ndarray],
    num_steps: int,
    progress: Callable[[float], None] = lambda fraction: None,
) -> None:
    """Trains a network in place on `(R, inputs)` float32, with two optimisers.

    The weights of hidden layers move along the orthogonal matrix nearest to their momentum (Muon,
    Jordan et al. 2024), which reached the loss of Adam in two thirds of the steps. All other
    weights use Adam. Each step draws `(n,)` rows; `loss_slope` takes their `(n, outputs)` and these
    rows to the gradient of the loss in the outputs.
    """
    parameters = [*network.weights, *network.biases]
    hidden = range(1, len(network.weights) - 1)
    first = [np.zeros_like(p) for p in parameters]
    second = [np.zeros_like(p) for p in parameters]
    with thread_pool() as pool:
        for step in range(num_steps):
            rows = draw()
            # Always two halves, so that sums have the same order on any number of cores.
            outputs, inputs, slopes = zip(
                *pool.map(network.forward, np.array_split(x[rows], 2)), strict=True
            )
            slope = np.array_split(loss_slope(np.concatenate(outputs), rows), 2)
            halves = pool.map(network.gradients, slope, inputs, slopes)
            gradients = [one + other for one, other in zip(*halves, strict=True)]
            rate = min(1.0, (step + 1) / (_WARM_UP * num_steps))
            rate *= (1.0 + np.cos(np.pi * step / num_steps)) / 2.0
            for p in hidden:
                first[p] = _MOMENTUM * first[p] + gradients[p]
            ahead = [gradients[p] + _MOMENTUM * first[p] for p in hidden]
            for p, direction in zip(hidden, pool.map(_orthogonal, ahead), strict=True):
                parameters[p] -= _HIDDEN_RATE * rate * direction
            for p, parameter in enumerate(parameters):
                if p in hidden:
                    continue
                gradient = gradients[p]
                first[p] += (1.0 - _FIRST) * (gradient - first[p])
                second[p] += (1.0 - _SECOND) * (np.square(gradient) - second[p])
                mean = first[p] / (1.0 - _FIRST ** (step + 1))
                square = second[p] / (1.0 - _SECOND ** (step + 1))
                parameter -= _OTHER_RATE * rate * mean / (np.sqrt(square) + 1e-8)
            progress((step + 1) / num_steps)


def toward(wanted: np.ndarray, of_row: np.ndarray) -> Callable[..., np.ndarray]:
    """The gradient of the mean squared error, for `train`.

    Row r of `(R,)` `of_row` says which of `(K, outputs)` float32 `wanted` that row wants.
    """
    return lambda found, rows: 2.0 * (found - wanted[of_row[rows]]) / len(found)


def _orthogonal(matrix: np.ndarray) -> np.ndarray:
    """Approximates the nearest orthogonal matrix by Newton-Schulz steps of degree five."""
    x = matrix / (np.linalg.norm(matrix) + 1e-9)
    for _ in range(5):
        square = x @ x.T
        x = 3.4445 * x + (-4.7750 * square + 2.0315 * square @ square) @ x
    return x
