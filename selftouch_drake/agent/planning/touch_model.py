"""How firmly the skin is touched at any motor configuration, as small networks learned it (naive).

The straight way from one touch to the next leaves the skin where the body curves. Neighbours in
motor space do not tell where: they are too far apart. But what is felt, and how firmly, is a smooth
function of the motor configuration. Networks that learned it from touches alone say of a
configuration beside them that it is touched less than lightly, or more than firmly, and in which
direction lies the skin. So a path is bent into the skin before anybody follows it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: Units of the hidden layers, touches per training step, and standard deviation of initial weights.
_HIDDEN, _BATCH, _GAIN = (128, 128, 128), 256, 0.7

#: Most training steps, and touches per step if there are few. With 6000 steps, networks of twelve
#: joints still tell nothing of the skin; with 10,000 they do. Modes share those of the network that
#: shows the need: 5000 do on each forearm of two arms (nine joints); kept networks take them all.
_MOST_STEPS, _ROWS_PER_STEP = 10_000, 3

#: Networks whose outputs are averaged, because chance decides how well one learns. Contact of 30
#: plans on each of two runs with nine and twelve joints: 91.7 to 99.9 % with one (six tried), 96.4
#: to 100 % with two, 98.8 and 100 % with three.
_NUM_NETWORKS = 3

#: Share of the touches that is held out; least correlation with what was felt in these. They are
#: the last ones: a body that travels feels nearly the same again and again, so that a network which
#: knows nothing but its path by heart would pass for one that knows the skin.
_HELD_OUT, _LEAST_CORRELATION = 0.125, 0.1

#: mu, median way from a touch to the nearest one of a linked kernel; beyond it, straight steps
#: leave the skin. It is 0.7 for six joints and 100,000 touches, 3.0 for twelve and 400,000. For
#: short steps a network is no better: contact of 40 plans on a cube with six joints is 99.3 % if
#: they are straight, 98.9 to 99.2 % if they are bent.
_LONG = 1.5

#: Share of the middles of straight steps that a network must expect to be lighter or firmer than
#: (nearly) all touches; otherwise it does not see that they leave the skin. Measured on 30 plans on
#: each of four runs with nine and twelve joints: it expects 1.5, 4.6, 5.0 and 8.8 %; bent steps
#: raise contact by -2.9, 2.4, 7.3 and 9.6 %.
_OFF, _EXTREME = 0.03, 0.001

#: Share of these limits that one network alone must pass. Where bent steps help, with nine and
#: twelve joints, one has a correlation of 0.12 to 0.18 and expects 3.4 to 7 %; where not, 0.05 and
#: 0.5 %.
_ALONE = 0.5

#: Shares of the touches that are predicted lighter than the least and the greatest firmness of a
#: path: those of the middle of the skin.
_LIGHTEST, _FIRMEST = 0.4, 0.6

#: mu, distance of the configurations that are bent, and the farthest that they go at a time.
_SPACING, _FARTHEST = 0.15, 0.2
_MOST_ROUNDS, _CLOSE = 8, 0.02

#: Names of the arrays of a mode, beside those of its network.
_ARRAYS = ("joints", "middle", "deviation", "typical")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Firmness:
    """What touches of one mode feel like: their firmness is a share, that of lighter touches.

    Firmness is counted from that of the median touch.

    Attributes:
        networks: from J standardised joints to firmness, and to the sensation less `typical`.
        joints: `(J,)` the joints that matter in the mode.
        middle: `(J,)` mu, mean of the scaled configurations.
        deviation: `(J,)` mu, their standard deviation.
        typical: `(S,)` unit L2 norm, the mean sensation.
        lightest: least firmness of a path.
        firmest: greatest firmness of a path.
    """

    networks: list[Network]
    joints: np.ndarray
    middle: np.ndarray
    deviation: np.ndarray
    typical: np.ndarray
    lightest: float
    firmest: float

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(n,)` firmness at scaled configurations `(n, J)`, and `(n, J)` its slope, per mu."""
        x = self.standardised(x)
        firm, slope = np.zeros(len(x)), np.zeros(x.shape)
        for network in self.networks:
            outputs, _, slopes = network.forward(x)
            first = np.zeros_like(outputs)
            first[:, 0] = 1.0
            firm += outputs[:, 0]
            slope += network.slope_of_inputs(first, slopes)
        num = len(self.networks)
        return firm / num, slope / (num * self.deviation)

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """`(n, 1 + S)` mean of the networks' outputs at scaled configurations `(n, J)`."""
        x = self.standardised(x)
        return np.mean([network(x) for network in self.networks], axis=0)

    def sensation(self, x: np.ndarray) -> np.ndarray:
        """`(n, S)` what is felt at scaled configurations `(n, all joints)`, without its scale."""
        return np.maximum(self.outputs(x[:, self.joints])[:, 1:] + self.typical, 0.0)

    def bent(self, x: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Scaled configurations `(n, J)` moved into the skin, along the slope, within limits."""
        x = np.array(x, dtype=float)
        for _ in range(_MOST_ROUNDS):
            firm, slope = self(x)
            short = firm.clip(self.lightest, self.firmest) - firm
            if np.abs(short).max(initial=0.0) < _CLOSE:
                break
            step = (short / np.maximum(np.square(slope).sum(axis=1), 1e-9))[:, None] * slope
            length = np.linalg.norm(step, axis=1, keepdims=True)
            step *= np.minimum(1.0, _FARTHEST / np.maximum(length, 1e-9))
            x = (x + step).clip(lower, upper)
        return x

    def standardised(self, x: np.ndarray) -> np.ndarray:
        """`(n, J)` float32, scaled configurations as the networks take them."""
        return ((x - self.middle) / self.deviation).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class TouchModel:
    """What the agent knows of the ways between its touches.

    Attributes:
        of_mode: what touches of each mode feel like; None where straight steps are short, or where
            touches did not tell.
    """

    of_mode: tuple[_Firmness | None, ...]

    @classmethod
    def learn(
        cls,
        representation: QuotientRepresentation,
        kernel_sensation: Callable[[], csr_array],
        *,
        seed: int = 0,
    ) -> "TouchModel":
        """Learns from stored touches; same seed, same bytes, on one machine.

        The `(R, S)` sensations of unit L2 norm, at each row of `kernel_q`, are asked for if there
        is something to learn.
        """
        modes = range(len(representation.mode_joints))
        straight = [_straight_steps(representation, mode) for mode in modes]
        long = [np.median(lengths) > _LONG for lengths, _ in straight]
        if not any(long):
            return cls((None,) * len(modes))
        felt = kernel_sensation()
        firmness = _firmness(representation, felt)
        sharing = np.isin(representation.kernel_mode, np.flatnonzero(long)).sum()
        return cls(
            tuple(
                _learned(representation, felt, firmness, mode, straight[mode][1], sharing, seed)
                if long[mode]
                else None
                for mode in modes
            )
        )

    def between(
        self,
        x: np.ndarray,
        modes: list[int],
        kept: list[bool],
        limits: tuple[np.ndarray, np.ndarray],
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Bends the steps of a plan into the skin, within limits `(J,)`; all are scaled.

        Of W waypoints `(W, J)`, some are kept where they are; of the W - 1 steps, the modes are
        below 0 in the air. Returns the waypoints, and the `(n, J)` to pass on each step.
        """
        x, steps = x.copy(), np.array(modes, dtype=int)
        passed = [x[:0]] * len(steps)
        for mode, firmness in enumerate(self.of_mode):
            of_mode = np.flatnonzero(steps == mode)
            if firmness is None or not len(of_mode):
                continue
            joints = firmness.joints
            lower, upper = (limit[joints] for limit in limits)
            moved = np.ix_([at for at in of_mode + 1 if not kept[at]], joints)
            x[moved] = firmness.bent(x[moved], lower, upper)
            ways = [_inner(x[at], x[at + 1]) for at in of_mode]
            inner = np.concatenate(ways)
            inner[:, joints] = firmness.bent(inner[:, joints], lower, upper)
            parts = np.split(inner, np.cumsum([len(way) for way in ways])[:-1])
            for at, part in zip(of_mode, parts, strict=True):
                passed[at] = part
        return x, passed

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All networks as arrays, by name."""
        arrays = {"num_modes": np.array(len(self.of_mode))}
        for mode, one in enumerate(self.of_mode):
            if one is not None:
                levels = np.array([one.lightest, one.firmest])
                named = {name: getattr(one, name) for name in _ARRAYS}
                for number, network in enumerate(one.networks):
                    layers = zip(network.weights, network.biases, strict=True)
                    for layer, (weights, biases) in enumerate(layers):
                        named[f"weights_{number}_{layer}"] = weights
                        named[f"biases_{number}_{layer}"] = biases
                named |= {"levels": levels}
                arrays |= {f"mode_{mode}_{name}": array for name, array in named.items()}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> "TouchModel":
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            KeyError: an array is missing.
        """
        found = list[_Firmness | None]()
        for mode in range(int(arrays["num_modes"])):
            prefix = f"mode_{mode}_"
            named = {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
            if not named:
                found.append(None)
                continue
            layers = range(len(_HIDDEN) + 1)
            lightest, firmest = named["levels"].tolist()
            networks = [
                Network(
                    weights=[named[f"weights_{number}_{layer}"] for layer in layers],
                    biases=[named[f"biases_{number}_{layer}"] for layer in layers],
                )
                for number in range(_NUM_NETWORKS)
            ]
            kept = {name: named[name] for name in _ARRAYS}
            found.append(_Firmness(networks=networks, lightest=lightest, firmest=firmest, **kept))
        return cls(tuple(found))


def _firmness(representation: QuotientRepresentation, sensation: csr_array) -> np.ndarray:
    """`(R,)` the share of the touches of the same kernel that are lighter.

    The sum of the readings, unlike their norm, hardly depends on where receptors are.
    """
    total = representation.kernel_strength * sensation.sum(axis=1)
    offsets = representation.kernel_offsets
    sizes = np.diff(offsets)
    kernel = np.repeat(np.arange(len(sizes)), sizes)
    share = np.empty(len(total), dtype=np.float32)
    order = np.lexsort((total, kernel))
    share[order] = (np.arange(len(total)) - offsets[kernel] + 0.5) / sizes[kernel]
    return share


def _touches_of(
    representation: QuotientRepresentation, mode: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`(n,)` rows of the touches of a mode, its J joints, and `(n, J)` scaled positions there."""
    rows = np.flatnonzero(representation.kernel_mode == mode)
    joints = np.flatnonzero(representation.mode_joints[mode])
    return rows, joints, representation.scaled(representation.kernel_q[rows])[:, joints]


def _learned(
    representation: QuotientRepresentation,
    sensation: csr_array,
    firmness: np.ndarray,
    mode: int,
    middles: np.ndarray,
    sharing: int,
    seed: int,
) -> _Firmness | None:
    """What touches of a mode feel like; None if it shows no need to bend steps at `middles`.

    The `sharing` touches are those of all modes with long steps.
    """
    rng = np.random.default_rng([seed, mode])
    rows, joints, positions = _touches_of(representation, mode)
    num_steps = min(_MOST_STEPS, len(rows) // _ROWS_PER_STEP)
    few_steps = min(len(rows) * _MOST_STEPS // sharing, num_steps)
    if few_steps < 1:
        return None
    firm, felt = firmness[rows], sensation[rows]
    typical = np.asarray(felt.mean(axis=0), dtype=np.float32)
    sizes = [len(joints), *_HIDDEN, 1 + felt.shape[1]]
    # One alone shows whether any are needed; after few steps, shared by modes, it is thrown away.
    num_trials = 1 + (few_steps < num_steps)
    num_networks = _NUM_NETWORKS + num_trials - 1
    networks = [Network.random(sizes, rng, gain=_GAIN) for _ in range(num_networks)]
    found = _Firmness(
        networks=networks[-_NUM_NETWORKS:],
        joints=joints,
        middle=positions.mean(axis=0),
        deviation=np.maximum(positions.std(axis=0), 1e-6),
        typical=typical,
        lightest=0.0,
        firmest=0.0,
    )
    x = found.standardised(positions)
    met = representation.kernel_row[rows]
    held_out = met >= np.quantile(met, 1.0 - _HELD_OUT)
    learning = np.flatnonzero(~held_out)

    def slope(found: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        wanted = np.column_stack([firm[drawn] - 0.5, felt[drawn].toarray() - typical])
        return 2.0 * (found - wanted.astype(np.float32)) / len(found)

    later = positions[held_out], firm[held_out]
    for number, network in enumerate(networks):
        steps = num_steps if number else few_steps
        train(network, x, lambda: rng.choice(learning, _BATCH), slope, steps)
        alone = replace(found, networks=[network])
        if number < num_trials and not _sees_need(alone, *later, middles, _ALONE):
            return None
    _agree(found.networks, x[held_out])
    if not _sees_need(found, *later, middles):
        return None
    predicted = found.outputs(later[0])[:, 0]
    lightest, firmest = np.quantile(predicted, [_LIGHTEST, _FIRMEST]).tolist()
    return replace(found, lightest=lightest, firmest=firmest)


def _sees_need(
    found: _Firmness, x: np.ndarray, firm: np.ndarray, middles: np.ndarray, share: float = 1.0
) -> bool:
    """Whether networks know the firmness `(n,)` of touches, and see that straight steps leave.

    The touches, `(n, J)`, and the middles of straight steps, `(m, J)`, are scaled. A share
    of the usual correlation and of the usual number of middles is enough.
    """
    predicted = found.outputs(x)[:, 0]
    if not np.corrcoef(predicted, firm)[0, 1] > _LEAST_CORRELATION * share:
        return False
    expected = found.outputs(middles)[:, 0]
    least, most = np.quantile(predicted, [_EXTREME, 1.0 - _EXTREME])
    return bool(np.mean((expected < least) | (expected > most)) >= _OFF * share)


def _agree(networks: list[Network], x: np.ndarray) -> None:
    """Gives the firmness that networks tell of touches `(n, J)` one median and one spread."""
    predicted = [network(x)[:, 0] for network in networks]
    spread = np.mean([one.std() for one in predicted])
    for network, one in zip(networks, predicted, strict=True):
        factor = spread / one.std()
        network.weights[-1][:, 0] *= factor
        network.biases[-1][0] = factor * (network.biases[-1][0] - np.median(one))


def _straight_steps(
    representation: QuotientRepresentation, mode: int
) -> tuple[np.ndarray, np.ndarray]:
    """Some straight ways from a touch of a mode to the nearest one of a linked kernel.

    Returns `(n,)` mu, their lengths, and `(n, J)` their middles; a way without length if there is
    none.
    """
    rng = np.random.default_rng(mode)
    rows, _, x = _touches_of(representation, mode)
    first = np.searchsorted(rows, representation.kernel_offsets)
    lengths, middles = list[float](), list[np.ndarray]()
    for i, j in rng.permutation(representation.edges)[:1000].tolist():
        here, there = x[first[i] : first[i + 1]], x[first[j] : first[j + 1]]
        if len(here) and len(there):
            start = here[rng.integers(len(here))]
            away = np.linalg.norm(there - start, axis=1)
            lengths.append(float(away.min()))
            middles.append((start + there[away.argmin()]) / 2)
    if not lengths:
        return np.zeros(1), x[:1]
    return np.array(lengths), np.array(middles)


def _inner(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """`(n, J)` configurations on the straight way, without its ends."""
    count = max(1, int(np.ceil(np.linalg.norm(end - start) / _SPACING)))
    return start + np.linspace(0.0, 1.0, count + 1)[1:-1, None] * (end - start)
