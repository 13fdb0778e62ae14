"""How well a body model fits the body: places of touches, and the axes of joints.

The experimenter's side: reads the truth.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import orthogonal_procrustes

from selftouch_drake.agent.body_model.model import BASE, UNUSED, BodyModel, JointKind
from selftouch_drake.agent.body_model.twists import transformed
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.evaluation.shape import KernelTruth, parts_on_skins
from selftouch_drake.experience.store import Contacts
from selftouch_drake.robot.kinematics import Kinematics

#: Fewest places from which a similarity in space is fitted.
_LEAST_PLACES = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Similarity:
    """A map that turns, mirrors if need be, scales and moves.

    Attributes:
        scale: a factor, positive.
        rotation: `(3, 3)` orthogonal; its determinant is -1 if it mirrors.
        shift: `(3,)` where the origin goes.
    """

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    @staticmethod
    def fitted(source: np.ndarray, target: np.ndarray) -> "Similarity":
        """The one that takes `(n, 3)` source nearest to `(n, 3)` target (Procrustes).

        Raises:
            ValueError: there are fewer than four places.
        """
        if len(source) < _LEAST_PLACES:
            raise ValueError(f"{len(source)} places fix no similarity; give {_LEAST_PLACES}")
        middle, goal = source.mean(axis=0), target.mean(axis=0)
        turned, singular_sum = orthogonal_procrustes(source - middle, target - goal)
        scale = float(singular_sum / np.square(source - middle).sum())
        return Similarity(scale=scale, rotation=turned.T, shift=goal - scale * (turned.T @ middle))

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """`(..., 3)` places, moved."""
        return self.scale * (places @ self.rotation.T) + self.shift

    @property
    def mirrors(self) -> bool:
        """Whether left becomes right."""
        return bool(np.linalg.det(self.rotation) < 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceError:
    """How far imagined places are from the true ones on one skin, after one similarity.

    All are root mean squares in percent of the extent of the skin: the diagonal of the box round
    the true contacts on it, in the frame of its link.

    Attributes:
        part: the part of the agent's body that shows the skin.
        place: of stored touches, against the true contact of each.
        kernel: of the mean of each kernel's touches, against the mean of its true contacts.
        share_known: 0 to 1, of the touches those whose place the model knows.
    """

    part: int
    place: float
    kernel: float
    share_known: float


def place_errors(
    model: BodyModel,
    representation: QuotientRepresentation,
    contacts: Contacts,
    truth: KernelTruth,
) -> dict[int, PlaceError]:
    """Scores the imagined places of all stored touches on each skin that an accepted part shows.

    Contacts and truth are as in `kernel_truth`. Touches with several contacts on one skin, of two
    fingers at once, are left out.

    Returns:
        The errors by the number of the skin; none for parts that were not accepted.
    """
    found = {}
    true = contacts_of_rows(representation, contacts, truth)
    sizes = np.diff(representation.kernel_offsets)
    of_row = np.repeat(np.arange(representation.num_targets), sizes)
    for skin, kernels in parts_on_skins(model.kernel_part, truth).items():
        part = int(model.kernel_part[kernels[0]])
        if not model.accepted_by_part[part]:
            continue
        rows = np.flatnonzero(np.isin(of_row, kernels) & np.isfinite(true).all(axis=1))
        imagined = model.place(representation.kernel_q[rows].astype(float), of_row[rows])
        known = np.isfinite(imagined).all(axis=1)
        share = float(known.mean())
        rows, imagined = rows[known], imagined[known]
        if len(np.unique(of_row[rows])) < _LEAST_PLACES:
            continue
        extent = np.linalg.norm(np.ptp(true[rows], axis=0))
        pairs = np.stack([imagined, true[rows]])
        means = np.stack(
            [pairs[:, of_row[rows] == kernel].mean(axis=1) for kernel in np.unique(of_row[rows])],
            axis=1,
        )
        found[skin] = PlaceError(
            part=part,
            place=float(100.0 * _rms_off(*pairs) / extent),
            kernel=float(100.0 * _rms_off(*means) / extent),
            share_known=share,
        )
    return found


def contacts_of_rows(
    representation: QuotientRepresentation, contacts: Contacts, truth: KernelTruth
) -> np.ndarray:
    """`(R, 3)` m, the contact of each stored touch on its kernel's skin; NaN if it has not one."""
    sizes = np.diff(representation.kernel_offsets)
    kernel = np.repeat(np.arange(representation.num_targets), sizes)
    row = contacts.row
    here = np.flatnonzero(contacts.skin == truth.skin[kernel[row]])
    found = np.full((len(contacts), 3), np.nan)
    found[row[here]] = contacts.p_LC[here]
    found[np.bincount(row[here], minlength=len(contacts)) != 1] = np.nan
    return found


def _rms_off(source: np.ndarray, target: np.ndarray) -> float:
    off = Similarity.fitted(source, target)(source) - target
    return float(np.sqrt(np.square(off).sum(axis=1).mean()))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axes:
    """The axes of J joints in one posture.

    Attributes:
        place: `(J, 3)` a place on the axis; NaN if a joint has none, because it slides.
        direction: `(J, 3)` unit vectors, of either sign; NaN if a joint has none.
        parent: `(J,)` the joint that carries each one; `BASE` or `UNUSED`.
    """

    place: np.ndarray
    direction: np.ndarray
    parent: np.ndarray

    def moved(self, similarity: Similarity) -> "Axes":
        """The same axes, turned, mirrored, scaled and moved."""
        return Axes(
            place=similarity(self.place),
            direction=self.direction @ similarity.rotation.T,
            parent=self.parent,
        )


def true_axes(kinematics: Kinematics, q: np.ndarray) -> Axes:
    """The axes of a robot's joints in the world at `(J,)` q, rad and m."""
    num_joints = len(kinematics.parent)
    X_WJ = np.zeros((num_joints, 4, 4))
    frames = np.zeros((num_joints, 4, 4))
    for joint, parent in enumerate(kinematics.parent):
        X_PF = np.vstack([kinematics.X_PF[joint], [0.0, 0.0, 0.0, 1.0]])
        frames[joint] = X_PF if parent < 0 else X_WJ[parent] @ X_PF
        moves = np.eye(4)
        if kinematics.turns[joint]:
            c, s = np.cos(q[joint]), np.sin(q[joint])
            moves[:2, :2] = [[c, -s], [s, c]]
        else:
            moves[2, 3] = q[joint]
        X_WJ[joint] = frames[joint] @ moves
    return Axes(
        place=np.where(kinematics.turns[:, None], frames[:, :3, 3], np.nan),
        direction=frames[:, :3, 2],
        parent=np.where(kinematics.parent < 0, BASE, kinematics.parent),
    )


def found_axes(model: BodyModel, q: np.ndarray) -> Axes:
    """The axes of a model's joints in the frame of its base at `(J,)` q, in its own unit.

    The place on the axis is the one nearest to the origin.
    """
    poses = model.link_poses(q[None])[0]
    place, direction = np.full((2, len(q), 3), np.nan)
    for joint in np.flatnonzero(model.used):
        w, v = model.twists[joint, :3], model.twists[joint, 3:]
        slides = model.joint_kind[joint] == JointKind.SLIDES
        along = v if slides else w
        if not along.any():
            continue
        # Joint and axis are carried by the link before.
        X = poses[model.joint_parent[joint]]
        direction[joint] = X[:3, :3] @ along / np.linalg.norm(along)
        if not slides:
            place[joint] = X[:3, :3] @ (np.cross(w, v) / (w @ w)) + X[:3, 3]
    return Axes(place=place, direction=direction, parent=model.joint_parent)


def onto_robot(
    model: BodyModel, truth: KernelTruth, X_WL: np.ndarray, q: np.ndarray
) -> Similarity | None:
    """The similarity that takes the model onto its robot, all accepted parts at once.

    Args:
        model: a model, of which parts may be accepted or not.
        truth: where its kernels truly are.
        X_WL: `(skins, 3, 4)` m, poses of the links that wear the skins, at `q`.
        q: `(J,)` a posture that both are in.

    Returns:
        From the frame of the model's base to the world; None if no part was accepted.
    """
    part = model.kernel_part
    kernels = np.flatnonzero(
        model.accepted_by_part[part]
        & (model.part_link[part] != UNUSED)
        & np.isfinite(model.kernel_place).all(axis=1)
    )
    if len(kernels) < _LEAST_PLACES:
        return None
    poses = model.link_poses(q[None])[0][model.part_link[part[kernels]]]
    imagined = transformed(poses, model.kernel_place[kernels])
    true = transformed(X_WL[truth.skin[kernels]], truth.positions[kernels])
    return Similarity.fitted(imagined, true)


def angles_between(found: Axes, true: Axes) -> np.ndarray:
    """`(J,)` degrees between the axes of each joint, 0 to 90; NaN where one has none."""
    cosine = np.abs(np.sum(found.direction * true.direction, axis=1))
    return np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))


def summary(errors: Mapping[int, PlaceError], names: list[str]) -> dict[str, object]:
    """The metrics of place errors, as `metrics.json` names them; none without an accepted part.

    Args:
        errors: by the number of the skin.
        names: of all skins.
    """
    if not errors:
        return {}
    place = [error.place for error in errors.values()]
    found: dict[str, object] = {
        "body_model_place_error_percent": float(np.mean(place)),
        "body_model_place_error_worst_percent": max(place),
        "body_model_kernel_error_percent": float(
            np.mean([error.kernel for error in errors.values()])
        ),
    }
    if len(names) > 1:
        found["body_model_place_error_percent_by_skin"] = {
            names[skin]: error.place for skin, error in errors.items()
        }
    return found
