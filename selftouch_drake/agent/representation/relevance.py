"""Finds which joints matter to a touch (naive).

When one hand touches, the joints of the other arm do not affect the sensation: in a distance
between motor configurations they are noise, and along a path they need not move. The agent does not
know that it has hands. But it can learn to predict a sensation from a configuration, and find out
on which joints the prediction depends. These differ between touches: each touch belongs to one of a
few modes, and each mode has its own set of joints that matter.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from selftouch_drake.agent.clusters import clusters
from selftouch_drake.agent.network import Network, standardised, toward, train
from selftouch_drake.agent.representation.quotient import LEAST_OF_PART, NO_MODE
from selftouch_drake.quotient.kernels import KernelSets

#: The network that predicts sensations: hidden layers, outputs (principal components of target
#: sensations), and training steps in each of two lessons, with configurations per step. Many
#: small steps teach more at first; large steps separate the modes better in the second lesson.
_HIDDEN = (128, 128, 128)
_MOST_OUTPUTS = 24
_LESSONS = ((360, 1024), (900, 2048))

#: The second lesson is skipped if the mean squared error on every part is below this share of the
#: variance. This holds for one body touched by one arm with six joints.
_WELL_LEARNED = 0.35

#: Fewest configurations per training step: with little data, more steps only overfit.
_ROWS_A_STEP = 32

#: If permuting any single joint raises the mean squared error by less than this share of the
#: variance, too little was learned on that part, and all joints matter there.
_LEAST_LEARNED = 0.15

#: Held-out configurations per part from which modes are found, and permutations per joint, here and
#: when the mode of a configuration is determined.
_NUM_TESTED = 5000
_NUM_EXCHANGES = 6

#: Fewest configurations of a part in which modes are searched, most modes, and fewest held-out
#: configurations per mode.
_FEWEST = 1500
_MOST_MODES = 6
_FEW = 50

#: Modes are accepted if this share of the configurations clearly belongs to one of them: measured
#: 0.93 to 0.98 with two arms, at most 0.66 where too little was learned and there is one mode.
_MOSTLY = 0.8

#: Least share of a kernel's touches of known mode that a mode has. Rarer ones are mostly mistakes,
#: by which plans expect a hand where it never was: on the infant, seeds 5 and 6, 78 of 105 were,
#: and of 29 with up to twice this share 4.
_MISTAKES = 0.05

#: Thresholds on the permutation importance of a joint, relative to the most important joint. Below
#: the first, the joint does not matter. Below the second, it does not matter either if it is more
#: than `_MUCH_MORE` times as important in another mode of the part: then the modes are not fully
#: separated. Measured with two arms on one body: 0.01 for joints of the idle arm, and 50 times as
#: much when that arm touches. On an infant: 0.02 to 0.06, and 10 times as much; the wrists of the
#: touching arm have 0.02 to 0.08: they hardly move the place of a touch, but can lose it. Keeping
#: too many joints does no harm.
_NOTHING, _LEAST_COST, _MUCH_MORE = 0.012, 0.08, 4.0

#: A configuration is assigned a mode if its error with that mode's other joints permuted is below
#: this share of the error in every other mode. With two arms on one body, 97 % of the
#: configurations get a mode, 0.1 % of them a wrong one. Comparing changes of the prediction instead
#: of errors gives 94 % and 2 %.
_SURE = 0.87


def touch_modes(
    sets: KernelSets,
    target_sensations: np.ndarray,
    part: np.ndarray,
    double: bool,
    *,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Finds the modes of touch, and the mode of each stored configuration.

    The sets may be scaled or not, targets are `(K, S)`, unit L2 norm, and `part` is `(K,)` the part
    of the body of each kernel; of double touches, kernels of two parts share configurations. The
    same seed gives the same bytes on one machine. Returns `(R,)` int8, the mode of each
    configuration, or `NO_MODE`; `(M, J)` bool, the joints that matter in each mode.
    """
    kernel = sets.kernel
    of_part = part[kernel]
    rng = np.random.default_rng(seed)
    tested = {}
    for number in np.flatnonzero(np.bincount(part) >= LEAST_OF_PART):
        rows = np.flatnonzero(of_part == number)
        if len(rows) >= _FEWEST:
            tested[number] = rng.permutation(rows)[: min(_NUM_TESTED, len(rows) // 5)]
    # In fragments, and where little was touched, all joints matter.
    mode = np.zeros(len(kernel), dtype=np.int8)
    relevant = np.ones((1, sets.x.shape[1]), dtype=bool)
    if not tested:
        return mode, relevant
    # Importance is measured on held-out rows: on memorised rows every joint would matter.
    held_out = np.zeros(len(kernel), dtype=bool)
    held_out[np.concatenate([*tested.values()])] = True
    x, sizes = standardised(sets.x), sets.sizes
    if double:
        # A configuration touches two parts, and is learned from once for each. The number of the
        # part is an input like a joint, but one that never counts as relevant.
        x = np.concatenate([x, np.eye(part.max() + 1, dtype=np.float32)[of_part]], axis=1)
    felt = target_sensations - np.average(target_sensations, axis=0, weights=sizes)
    _, _, axes = np.linalg.svd(felt, full_matrices=False)
    outputs = felt @ axes[:_MOST_OUTPUTS].T
    spread = np.sqrt(np.average(np.square(outputs).sum(axis=1), weights=sizes))
    outputs = (outputs / (spread if spread > 0 else 1.0)).astype(np.float32)
    network = Network.random([x.shape[1], *_HIDDEN, outputs.shape[1]], rng)
    expected = _Expectation(network, x, kernel, outputs, rng)
    _learn(expected, of_part, np.flatnonzero(~held_out), [*tested.values()])
    for number, some in tested.items():
        rows = np.flatnonzero(of_part == number)
        modes = _modes(expected, some)
        given = _modes_of(expected, rows, modes)
        mode[rows] = np.where(given == NO_MODE, NO_MODE, given + len(relevant))
        relevant = np.concatenate([relevant, modes[:, : sets.x.shape[1]]])
    return _numbered(likely_modes(mode, kernel), relevant)


@dataclass(frozen=True, slots=True, eq=False)
class _Expectation:
    """A network that predicts the sensation of a configuration.

    Attributes:
        network: maps standardised configurations to `outputs`.
        x: `(R, J)` float32, standardised configurations.
        kernel: `(R,)` the kernel of each configuration.
        outputs: `(K, D)` float32, principal components of the target sensations.
        rng: permutes joints and draws batches.
    """

    network: Network
    x: np.ndarray
    kernel: np.ndarray
    outputs: np.ndarray
    rng: np.random.Generator

    def off(self, rows: np.ndarray, joints: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """`(n,)` mean squared distance of predictions with `joints` `(J,)` permuted from `felt`."""
        x, off = self.x[rows], []
        for _ in range(_NUM_EXCHANGES if joints.any() else 1):
            found = self.network(np.where(joints, x[self.rng.permutation(len(x))], x))
            off.append(np.square(found - felt).sum(axis=1))
        return np.mean(off, axis=0)

    def error(self, rows: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """`(n,)` squared error of the prediction with `joints` `(J,)` bool permuted."""
        return self.off(rows, joints, self.outputs[self.kernel[rows]])

    def by_chance(self, rows: np.ndarray) -> float:
        """Variance of what is felt at `rows`: the error of always predicting its mean."""
        return float(self.outputs[self.kernel[rows]].var(axis=0).sum())


def _learn(
    expected: _Expectation,
    of_part: np.ndarray,
    trained: np.ndarray,
    tested: list[np.ndarray],
) -> None:
    """Trains the network on some rows, until it predicts the tested rows of each part well."""
    # Half of each batch is drawn from all rows, half evenly from the parts, so that rarely touched
    # parts are also learned.
    by_part = trained[np.argsort(of_part[trained], kind="stable")]
    sizes = np.bincount(of_part[trained])
    sizes = sizes[sizes > 0]
    first, rng = np.cumsum(sizes) - sizes, expected.rng

    def draw(count: int) -> np.ndarray:
        some = rng.integers(len(sizes), size=count // 2)
        of_all = trained[rng.integers(len(trained), size=count // 2)]
        of_each = by_part[first[some] + (rng.random(len(some)) * sizes[some]).astype(int)]
        return np.concatenate([of_all, of_each])

    x, none = expected.x, np.zeros(expected.x.shape[1], dtype=bool)
    affordable = min(sum(steps for steps, _ in _LESSONS), len(x) // _ROWS_A_STEP)
    done = 0
    for most_steps, count in _LESSONS:
        num_steps = min(most_steps, affordable - done)
        train(
            expected.network,
            x,
            partial(draw, count),
            toward(expected.outputs, expected.kernel),
            num_steps,
        )
        done += num_steps
        if done == affordable or all(
            expected.error(rows, none).mean() < _WELL_LEARNED * expected.by_chance(rows)
            for rows in tested
        ):
            break


def _modes(expected: _Expectation, rows: np.ndarray) -> np.ndarray:
    """`(M, J)` bool, joints that matter in each mode of a part of the body.

    Configurations are clustered by how much each joint changes the prediction there. A first guess
    of a mode is the joints that matter to a cluster at least half as much as to any other. Each
    configuration is then assigned to a mode, and the joints that matter are found again. The number
    of modes rises as long as no set of joints contains another: configurations between two modes
    need the joints of both. Modes that leave many configurations unassigned are rejected.
    """
    each = np.eye(expected.x.shape[1], dtype=bool)
    now = expected.network(expected.x[rows])
    change = np.sqrt([expected.off(rows, joint, now) for joint in each]).T
    share = change / np.maximum(np.linalg.norm(change, axis=1, keepdims=True), 1e-12)
    found = _matter(_costs(expected, rows)[None])
    for count in range(2, _MOST_MODES + 1):
        cluster = clusters(np.log(share + 1e-3), count)
        cost = np.array([_costs(expected, rows[cluster == c]) for c in range(count)])
        guess = cost >= cost.max(axis=0) / 2
        given = _modes_of(expected, rows, guess)
        few = np.bincount(given + 1, minlength=count + 1)[1:].min() < _FEW
        if _contained(guess) or few or np.mean(given != NO_MODE) < _MOSTLY:
            break
        cost = np.array([_costs(expected, rows[given == m]) for m in range(count)])
        sets = _matter(cost)
        if _contained(sets):
            break
        found = sets
    return found


def _costs(expected: _Expectation, rows: np.ndarray) -> np.ndarray:
    """`(J,)` permutation importance: the rise of the mean squared error with each joint permuted.

    Relative to the most important joint; all 1 where too little was learned.
    """
    each = np.eye(expected.x.shape[1], dtype=bool)
    before = expected.error(rows, np.zeros(len(each), dtype=bool)).mean()
    cost = np.array([expected.error(rows, joint).mean() - before for joint in each])
    learned = cost.max() >= max(_LEAST_LEARNED * expected.by_chance(rows), 1e-6)
    return cost / cost.max() if learned else np.ones(len(cost))


def _matter(cost: np.ndarray) -> np.ndarray:
    """`(M, J)` bool, the joints that matter, by their importance in each mode of a part."""
    elsewhere = cost.max(axis=0) > _MUCH_MORE * cost
    return (cost >= _LEAST_COST) | ((cost >= _NOTHING) & ~elsewhere)


def _contained(sets: np.ndarray) -> bool:
    """Whether one of the sets `(M, J)` holds another."""
    holds = (sets[:, None] | sets == sets[:, None]).all(axis=2)
    return bool(holds.sum() > len(sets))


def _modes_of(expected: _Expectation, rows: np.ndarray, modes: np.ndarray) -> np.ndarray:
    """`(n,)` the mode of each row: the one whose other joints can be permuted with least error."""
    if len(modes) == 1:
        return np.zeros(len(rows), dtype=int)
    error = np.sqrt([expected.error(rows, ~joints) for joints in modes])
    least, second = np.sort(error, axis=0)[:2]
    return np.where(least < _SURE * second, error.argmin(axis=0), NO_MODE)


def likely_modes(mode: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """`(R,)` modes of touches of kernels `(R,)`, unknown where they are rare in their kernel."""
    known = np.flatnonzero(mode != NO_MODE)
    of_mode = kernel[known] * (int(mode.max()) + 1) + mode[known]
    share = np.bincount(of_mode)[of_mode] / np.bincount(kernel[known])[kernel[known]]
    found = mode.copy()
    found[known[share < _MISTAKES]] = NO_MODE
    return found


def _numbered(mode: np.ndarray, relevant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merges modes with the same joints, and drops modes without configurations."""
    known = mode >= 0
    used, mode_of = np.unique(mode[known], return_inverse=True)
    relevant, same = np.unique(relevant[used], axis=0, return_inverse=True)
    numbered = np.full(len(mode), NO_MODE, dtype=np.int8)
    numbered[known] = same.ravel()[mode_of]
    return numbered, relevant
