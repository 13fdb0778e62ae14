"""Metres for a body model: touch tells no length, so one has to be known."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.model import UNUSED, BodyModel
from selftouch_drake.experiment.errors import closest
from selftouch_drake.export.place_slopes import place_slopes

# cos of the angle up to which two axes count as parallel: ten degrees, as in the help.
_PARALLEL = np.cos(np.radians(10.0))
# A length below so many of its standard errors may be nothing at all.
_LEAST_ERRORS = 3.0
# Of the extent of the skin. Below it a length is nothing, whatever its standard error is.
_LEAST_SHARE = 1e-3
# For derivatives by differences, relative to entries of a twist, which are near 1.
_STEP = 1e-6
# Covariances are too sure by so much: lengths of eight bodies that are made up were within two
# standard errors in 87 % (`benchmarks/accuracy/standard_errors.py --seeds 0 1 2 3 4 5 6 7`).
_TOO_SURE = 1.4
# Of the depth by which receptors are raised: at edges touches are less deep than elsewhere.
# On a cube distances over edges were 3 % too long, and claims without it 1.7 %.
_DEPTH_OFF = 0.3
# A scale that is less exact than this, relatively, is told badly, if others are better by a factor.
_BADLY, _BETTER = 0.03, 1.5
# Touches about a receptor that tell how its place depends on the joints.
_ABOUT = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """What one unit of length of a model is.

    Attributes:
        metres: of one unit; 1 if nothing is known, and then lengths stay in the model's unit.
        sigma: standard error of `metres`; NaN if nobody knows it.
        known: whether `metres` are metres.
        source: the known length, in words; empty if there is none.
    """

    metres: float = 1.0
    sigma: float = np.nan
    known: bool = False
    source: str = ""

    def text(self) -> str:
        """In a sentence without a dash, which comments of XML could not hold."""
        if not self.known:
            return "lengths are in an arbitrary unit, because no length of the body is known"
        error = "unknown" if np.isnan(self.sigma) else f"{self.sigma / self.metres:.2g}"
        return (
            f"lengths are in metres, because {self.source}; relative standard error of the scale: "
            f"{error}"
        )


def unit_from_joints(model: BodyModel, first: str, second: str, metres: float) -> Unit:
    """The unit, from the distance between the axes of two joints where all joints read 0.

    If the axes are within ten degrees of parallel, it is the distance across their mean direction;
    else the shortest one.

    Args:
        model: in its own unit.
        first: name of a joint that turns.
        second: name of another one.
        metres: the true distance.

    Raises:
        ValueError: there is no such joint, one does not turn, or the axes meet.
    """
    _require_length(metres)
    if first == second:
        raise ValueError(f"--length names joint {first} twice; name two joints")
    joints = [_turning_joint(model, name) for name in (first, second)]
    twists = model.twists[joints]
    own = np.ravel(6 * np.array(joints)[:, None] + np.arange(6))
    apart = axes_apart(twists)
    error = _propagated(axes_apart, twists, model.covariance[np.ix_(own, own)])
    if apart < max(_LEAST_SHARE * extent(model), _LEAST_ERRORS * np.nan_to_num(error)):
        raise ValueError(
            f"--length: the axes of {first} and {second} meet, or nearly so: they are {apart:.2g} "
            f"± {error:.1g} units apart; name two joints whose axes are farther apart"
        )
    return Unit(
        metres=metres / apart,
        sigma=metres / apart * error / apart,
        known=True,
        source=f"the axes of {first} and {second} are {metres:g} m apart where all joints read 0",
    )


def unit_from_receptors(
    model: BodyModel,
    names: Sequence[str],
    first: str,
    second: str,
    metres: float,
    *,
    depth: float = 0.0,
    touches: tuple[np.ndarray, np.ndarray] | None = None,
) -> Unit:
    """The unit, from the distance in a straight line between two receptors on one link.

    Args:
        model: in its own unit.
        names: `(S,)` names of the receptors; numbers in the order of the readings are understood
            too.
        first: name of a receptor.
        second: name of another one.
        metres: the true distance, on the surface of the skin.
        depth: m, how deep under that surface the model has the receptors.
        touches: `(R, J)` readings and `(R,)` target sensations, by which the errors of joints count
            too; None: only those of receptors do.

    Raises:
        ValueError: there is no such receptor, one was never met, they are on different links, or
            too near to each other.
    """
    _require_length(metres)
    receptors = [_met_receptor(model, names, name) for name in (first, second)]
    if receptors[0] == receptors[1]:
        raise ValueError(f"--distance names receptor {first} twice; name two receptors")
    links = model.part_link[model.receptor_part[receptors]]
    if links[0] != links[1] or links[0] == UNUSED:
        raise ValueError(
            f"--distance: receptors {first} and {second} are on different links, so their distance "
            "changes; name two on one link"
        )
    between = np.subtract(*model.receptor_place[receptors])
    apart = float(np.linalg.norm(between))
    # Of the surface above them.
    outward = depth * np.nan_to_num(np.subtract(*model.receptor_normal[receptors]))
    scale = _scale(between, outward, metres)
    along = scale * between + outward
    error = _error_between(model, receptors, along / np.linalg.norm(along), touches)
    if scale > 0:
        error = float(np.hypot(error, np.sqrt(2.0) * _DEPTH_OFF * depth / scale))
    if apart < max(_LEAST_SHARE * extent(model), _LEAST_ERRORS * np.nan_to_num(error)):
        raise ValueError(
            f"--distance: receptors {first} and {second} are {apart:.2g} ± {error:.1g} units apart,"
            " too near to give a scale; name two that are farther apart"
        )
    if not scale > 0:
        raise ValueError(
            f"--distance: receptors {first} and {second} cannot be {metres:g} m apart if touchers "
            f"pass {depth:g} m under the skin; give another --depth or two others"
        )
    return Unit(
        metres=scale,
        sigma=scale * error / abs(float(between @ along)) * float(np.linalg.norm(along)),
        known=True,
        source=f"receptors {first} and {second} are {metres:g} m apart",
    )


def better_joints(model: BodyModel, unit: Unit) -> str:
    """Which two joints would tell the scale better, in a sentence; empty if it is told well.

    Args:
        model: as the unit was taken from.
        unit: that a known length gives.
    """
    if not unit.sigma / unit.metres > _BADLY:
        return ""
    least, best = unit.sigma / unit.metres / _BETTER, None
    turning = np.flatnonzero(model.used & model.twists[:, :3].any(axis=1)).tolist()
    for pair in itertools.combinations((model.joint_names[joint] for joint in turning), 2):
        try:
            found = unit_from_joints(model, *pair, 1.0)
        except ValueError:  # they meet
            continue
        if found.sigma / found.metres < least:
            least, best = found.sigma / found.metres, pair
    if best is None:
        return ""
    return (
        f"this length tells the scale badly: the distance of the axes of {best[0]} and {best[1]} "
        f"would tell it with a relative standard error of {least:.2g}"
    )


def extent(model: BodyModel) -> float:
    """Diagonal of the box round the largest part of the skin, in the model's unit."""
    found = [0.0]
    for part in range(len(model.part_link)):
        place = model.kernel_place[model.kernel_part == part]
        known = place[np.isfinite(place).all(axis=1)]
        if len(known):
            found.append(float(np.linalg.norm(np.ptp(known, axis=0))))
    return max(found) or 1.0


def _require_length(metres: float) -> None:
    if not (np.isfinite(metres) and metres > 0):
        raise ValueError(f"the known length is {metres:g} m; give a positive number of metres")


def _turning_joint(model: BodyModel, name: str) -> int:
    if name not in model.joint_names:
        hint = closest(name, model.joint_names) or f"joints: {', '.join(model.joint_names)}"
        raise ValueError(f"--length names joint {name!r}, which the robot does not have; {hint}")
    joint = model.joint_names.index(name)
    if not model.used[joint]:
        raise ValueError(
            f"--length: joint {name} is of no use to the model, which knows no axis of it; name "
            "another"
        )
    if not model.twists[joint, :3].any():
        raise ValueError(
            f"--length: joint {name} slides, so its axis has no place; name two joints that turn"
        )
    return joint


def _met_receptor(model: BodyModel, names: Sequence[str], name: str) -> int:
    if name in names:
        found = list(names).index(name)
    elif name.isdecimal() and int(name) < len(names):
        found = int(name)
    else:
        hint = closest(name, names) or f"give a number from 0 to {len(names) - 1}"
        raise ValueError(f"--distance names receptor {name!r}, which is not there; {hint}")
    if not np.isfinite(model.receptor_place[found]).all():
        raise ValueError(f"--distance: receptor {name} was never met; name another")
    return found


def axes_apart(twists: np.ndarray) -> float:
    """Distance between the axes of two `(2, 6)` turns."""
    w, v = twists[:, :3], twists[:, 3:]
    along = w / np.linalg.norm(w, axis=1, keepdims=True)
    # The point of each axis that is nearest to the origin.
    foot = np.cross(w, v) / np.square(w).sum(axis=1, keepdims=True)
    between = foot[1] - foot[0]
    cosine = along[0] @ along[1]
    if abs(cosine) >= _PARALLEL:
        mean = along[0] + np.sign(cosine) * along[1]
        mean /= np.linalg.norm(mean)
        return float(np.linalg.norm(between - (between @ mean) * mean))
    normal = np.cross(*along)
    return float(abs(between @ normal) / np.linalg.norm(normal))


def _propagated(
    measure: Callable[[np.ndarray], float], values: np.ndarray, covariance: np.ndarray
) -> float:
    """Standard error of a measure of values with a covariance; NaN if an error is unknown."""
    slope = np.empty(values.size)
    for number, index in enumerate(np.ndindex(values.shape)):
        step = np.zeros(values.shape)
        step[index] = _STEP
        slope[number] = (measure(values + step) - measure(values - step)) / (2 * _STEP)
    return _TOO_SURE * float(np.sqrt(slope @ covariance @ slope))


def _scale(between: np.ndarray, outward: np.ndarray, metres: float) -> float:
    """The scale s at which `|s between + outward|` is so many metres; NaN if there is none."""
    square, mixed = float(between @ between), float(between @ outward)
    rest = mixed**2 - square * (float(outward @ outward) - metres**2)
    return (np.sqrt(rest) - mixed) / square if rest >= 0 else np.nan


def _error_between(
    model: BodyModel,
    receptors: Sequence[int],
    along: np.ndarray,
    touches: tuple[np.ndarray, np.ndarray] | None,
) -> float:
    """Standard error of how far one receptor is from another, along a `(3,)` direction.

    That of each place by chance, and that of the joints, by the touches about them.
    """
    # The standard error of a place is that of three coordinates; one of them counts.
    square = float(np.square(model.receptor_sigma[receptors]).sum() / 3.0)
    if touches is not None:
        slope = np.subtract(*(_receptor_slope(model, receptor, *touches) for receptor in receptors))
        joints = float(along @ slope @ np.nan_to_num(model.covariance) @ slope.T @ along)
        square += _TOO_SURE**2 * joints
    return float(np.sqrt(square))


def _receptor_slope(
    model: BodyModel, receptor: int, q: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """`(3, 6 J + 3 U)` derivatives of a receptor's place, as a mean over the touches about it."""
    part = int(model.receptor_part[receptor])
    rows = np.flatnonzero((model.kernel_part[target] == part) & (model.kernel_toucher >= 0))
    place = model.place(q[rows], target[rows])
    far = np.nan_to_num(np.linalg.norm(place - model.receptor_place[receptor], axis=1), nan=np.inf)
    near = rows[np.argsort(far)[:_ABOUT]]
    slope = np.zeros((3, model.twists.size + model.toucher_place.size))
    for toucher in np.unique(model.kernel_toucher[near]).tolist():
        own = near[model.kernel_toucher[near] == toucher]
        slope += place_slopes(model, q[own], part, toucher).sum(axis=0)
    return slope / len(near)
