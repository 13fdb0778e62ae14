"""Which joints matter to a touch (naive).

When one hand touches, the joints of the other arm say nothing of what is felt: in a distance
between motor configurations they are noise, and on a path they may stay where they are. The agent
does not know that it has hands. But it can learn to expect a sensation from a configuration, and
notice which joints its expectation depends on. In some touches these are others than in others: a
touch is of one of a few modes, each with its own set of joints that matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from sklearn.cluster import KMeans

from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.representation.quotient import LEAST_KERNELS

#: Stands in `kernel_mode` for a configuration of which it is not known.
NO_MODE = -1

#: Of the network that expects sensations: hidden layers, outputs (principal components of target
#: sensations), steps of training and configurations in each.
_HIDDEN = (128, 128, 128)
_MOST_OUTPUTS = 24
_NUM_STEPS = 1200
_BATCH = 2048

#: Configurations of a part that modes are found from, how many exchanges of a joint are tried on
#: each, and on each configuration that is told its mode.
_NUM_TESTED = 6000
_NUM_EXCHANGES = 4

#: Most modes of a part.
_MOST_MODES = 6

#: A joint matters if to exchange it costs this share of what the costliest joint does. Of two arms
#: at one body, the joints of the idle arm cost up to 0.04, those of the other 0.5 or more; of a
#: hand on the other forearm, the wrist that is touched behind costs 0.05, all others 0.15 or more.
_LEAST_COST = 0.07

#: A configuration is of a mode if to exchange the joints that do not matter there changes what is
#: expected by less than this share of what it changes in any other mode.
_SURE = 0.6

# Configurations that pass the network at a time.
_CHUNK = 16_384


def relevant_joints(
    kernel_x: np.ndarray,
    kernel_offsets: np.ndarray,
    target_sensations: np.ndarray,
    part: np.ndarray,
    *,
    seed: int,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[np.ndarray, np.ndarray]:
    """Finds the modes of touch, and which each stored configuration is of.

    Args:
        kernel_x: `(R, J)` configurations grouped by kernel, scaled or not.
        kernel_offsets: `(K + 1,)` kernel k owns rows `kernel_offsets[k]:kernel_offsets[k + 1]`.
        target_sensations: `(K, S)` unit L2 norm.
        part: `(K,)` the part of the body of each kernel, 0 the largest.
        seed: the same seed gives the same bytes, on one machine.
        progress: called with the fraction done.

    Returns:
        `(R,)` int8, the mode of each configuration, or `NO_MODE`; `(M, J)` bool, the joints that
        matter in each mode.
    """
    kernel = np.repeat(np.arange(len(part)), np.diff(kernel_offsets))
    of_part = part[kernel]
    everything = np.ones((1, kernel_x.shape[1]), dtype=bool)
    rng = np.random.default_rng(seed)
    expected = _Expectation.learned(kernel_x, kernel, target_sensations, of_part, rng, progress)
    mode, relevant = np.zeros(len(kernel_x), dtype=np.int8), everything
    for number in np.flatnonzero(np.bincount(part) >= LEAST_KERNELS):
        rows = np.flatnonzero(of_part == number)
        modes = _modes(expected, rng.permutation(rows)[:_NUM_TESTED], rng)
        mode[rows] = _told(expected, rows, modes, rng) + len(relevant)
        relevant = np.concatenate([relevant, modes])
    return _numbered(mode, relevant)


class _Expectation:
    """A network that expects a sensation from a configuration, and rows to try it on.

    Args:
        network: from standardised configurations to `outputs`.
        x: `(R, J)` float32, standardised configurations.
        kernel: `(R,)` the kernel of each.
        outputs: `(K, D)` float32, principal components of the target sensations.
    """

    def __init__(self, network: Network, x: np.ndarray, kernel: np.ndarray, outputs: np.ndarray):
        self.x = x
        self._network, self._kernel, self._outputs = network, kernel, outputs

    @classmethod
    def learned(
        cls,
        kernel_x: np.ndarray,
        kernel: np.ndarray,
        target_sensations: np.ndarray,
        of_part: np.ndarray,
        rng: np.random.Generator,
        progress: Callable[[float], None],
    ) -> _Expectation:
        deviation = kernel_x.std(axis=0)
        x = (kernel_x - kernel_x.mean(axis=0)) / np.where(deviation > 0, deviation, 1.0)
        x = x.astype(np.float32)
        felt = target_sensations - target_sensations[kernel].mean(axis=0)
        _, _, axes = np.linalg.svd(felt, full_matrices=False)
        outputs = felt @ axes[:_MOST_OUTPUTS].T
        spread = np.sqrt(np.mean(np.square(outputs[kernel]).sum(axis=1)))
        outputs = (outputs / (spread if spread > 0 else 1.0)).astype(np.float32)
        # Half of the rows as they come, half evenly from all parts: a part that is seldom touched
        # is learned as well.
        by_part = np.argsort(of_part, kind="stable")
        sizes = np.bincount(of_part)
        first = np.cumsum(sizes) - sizes
        rows = np.empty(0, dtype=int)

        def batch() -> np.ndarray:
            nonlocal rows
            some = rng.integers(len(sizes), size=_BATCH // 2)
            rows = np.concatenate(
                [
                    rng.integers(len(x), size=_BATCH // 2),
                    by_part[first[some] + (rng.random(len(some)) * sizes[some]).astype(int)],
                ]
            )
            return x[rows]

        network = Network.random([x.shape[1], *_HIDDEN, outputs.shape[1]], rng)
        train(
            network,
            batch,
            lambda found: 2.0 * (found - outputs[kernel[rows]]) / len(found),
            _NUM_STEPS,
            progress,
        )
        return cls(network, x, kernel, outputs)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        chunks = [self._network(x[i : i + _CHUNK]) for i in range(0, len(x), _CHUNK)]
        return np.concatenate(chunks) if chunks else np.empty((0, self._outputs.shape[1]))

    def error(self, rows: np.ndarray, x: np.ndarray) -> float:
        """Mean squared error of what is expected at `x`, against what was felt at `rows`."""
        off = self(x) - self._outputs[self._kernel[rows]]
        return float(np.mean(np.square(off).sum(axis=1)))

    def changes(
        self, rows: np.ndarray, joints: np.ndarray, rng: np.random.Generator
    ) -> Iterator[np.ndarray]:
        """`(n,)` how far what is expected moves, each time `joints` `(J,)` bool are exchanged."""
        before = self(self.x[rows])
        for _ in range(_NUM_EXCHANGES):
            off = self(exchanged(self.x[rows], joints, rng)) - before
            yield np.sqrt(np.square(off).sum(axis=1))


def exchanged(x: np.ndarray, joints: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """`(n, J)` configurations with `joints` `(J,)` bool as in others of them."""
    return np.where(joints, x[rng.permutation(len(x))], x)


def _modes(expected: _Expectation, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """`(M, J)` bool, joints that matter in each mode of a part of the body.

    Configurations are clustered by how much each joint changes what is expected there. As many
    modes are found as there are clusters whose sets of joints do not contain each other: what is
    between two modes needs the joints of both.
    """
    num_joints = expected.x.shape[1]
    change = np.stack(
        [
            np.mean(list(expected.changes(rows, joint, rng)), axis=0)
            for joint in np.eye(num_joints, dtype=bool)
        ],
        axis=1,
    )
    share = change / np.maximum(np.linalg.norm(change, axis=1, keepdims=True), 1e-12)
    found = _mattering(expected, rows, rng)[None]
    for count in range(2, _MOST_MODES + 1):
        clusters = KMeans(count, n_init=4, random_state=0).fit_predict(np.log(share + 1e-3))
        sets = np.array([_mattering(expected, rows[clusters == c], rng) for c in range(count)])
        if _contained(sets):
            break
        found = sets
    return found


def _mattering(
    expected: _Expectation, rows: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """`(J,)` bool, the joints whose exchange makes the expectation worse."""
    x = expected.x[rows]
    before = expected.error(rows, x)
    cost = np.array(
        [
            np.mean([expected.error(rows, exchanged(x, joint, rng)) for _ in range(2)]) - before
            for joint in np.eye(x.shape[1], dtype=bool)
        ]
    )
    # An expectation that is no better than chance says nothing.
    return cost >= _LEAST_COST * cost.max() if cost.max() > 0 else np.ones(len(cost), dtype=bool)


def _contained(sets: np.ndarray) -> bool:
    """Whether one of the sets `(M, J)` holds another."""
    holds = (sets[:, None] | sets == sets[:, None]).all(axis=2)
    return bool(holds.sum() > len(sets))


def _told(
    expected: _Expectation, rows: np.ndarray, modes: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """`(n,)` the mode of each row: the one whose other joints can be exchanged and change least.

    `NO_MODE - 1` and below are no modes, whatever is added.
    """
    if len(modes) == 1:
        return np.zeros(len(rows), dtype=np.int8)
    change = np.stack(
        [np.mean(list(expected.changes(rows, ~joints, rng)), axis=0) for joints in modes], axis=1
    )
    least, second = np.sort(change, axis=1)[:, :2].T
    return np.where(least < _SURE * second, change.argmin(axis=1), -128).astype(np.int8)


def _numbered(mode: np.ndarray, relevant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes of the same joints made one, those that no configuration is of left out."""
    known = mode >= 0
    used, mode_of = np.unique(mode[known], return_inverse=True)
    relevant, same = np.unique(relevant[used], axis=0, return_inverse=True)
    numbered = np.full(len(mode), NO_MODE, dtype=np.int8)
    numbered[known] = same.ravel()[mode_of]
    return numbered, relevant
