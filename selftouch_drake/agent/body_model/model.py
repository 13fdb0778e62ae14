"""What the agent found out about the mechanics of its body: joints, links, skin, and how sure.

Every rigid tree of joints can be rooted at any of its links; the agent roots it at one of its own
choice, the base. The link of a joint is what that joint carries. All twists are written in one
frame, that of the whole body where every joint reads 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Self

import numpy as np

from selftouch_drake.agent.body_model.chain import carry, exponentials
from selftouch_drake.agent.body_model.scene import BLUNT
from selftouch_drake.agent.body_model.support import (
    beside,
    blended_normals,
    bulge,
    nearest_toucher,
)
from selftouch_drake.agent.body_model.twists import chained, transformed, transposed
from selftouch_drake.agent.records import Record

#: Of the arrays of a model; a file of another version is refused.
VERSION = 1

#: Values of `joint_parent`: the joint stands on the base, or does not matter anywhere.
BASE, UNUSED = -1, -2


class JointKind(IntEnum):
    """What a joint does, as far as touch tells."""

    UNUSED = 0
    TURNS = 1
    SLIDES = 2
    #: The data do not tell whether it turns or slides.
    OPEN = 3


class VersionError(ValueError):
    """The arrays of a model were made by another version."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Receptors:
    """The receptors of the body, in the order of the readings.

    Attributes:
        place: `(S, 3)` in the frame of the link that wears the receptor, the model's unit of
            length; NaN where the receptor was never met.
        normal: `(S, 3)` outward normal of the skin there, in the same frame; NaN where unknown.
        sigma: `(S,)` standard error of the place, the model's unit of length; NaN where unknown.
        part: `(S,)` part of the body, -1 where the receptor was never met.
    """

    place: np.ndarray
    normal: np.ndarray
    sigma: np.ndarray
    part: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyModel(Record):
    """A tree of joints, what they carry, and whether held-out touches agree with it.

    J joints, P parts of the skin, U touchers, K target sensations, R stored touches, S receptors.
    Readings of joints are in units that nobody knows; lengths are in the model's own unit, and the
    whole may be the mirror image of the body: touch tells neither. With the frame of a link is
    meant the frame of the whole body at readings of 0, carried along by the link:

        X_j(q) = X_parent(j)(q) @ exp(twist_j * q_j),    X_BASE = identity

    Attributes:
        joint_names: `(J,)` names of the joints; carried along, never read.
        joint_parent: `(J,)` the joint whose link carries each joint; in no order. `BASE` or
            `UNUSED`.
        twists: `(J, 6)` w and v per unit of the joint's reading, in the frame of the whole body; 0
            for joints that are not used.
        twist_sigma: `(J, 6)` standard errors; NaN where open.
        covariance: `(6 J + 3 U, 6 J + 3 U)` mean squared errors of the twists, and then of the
            touchers' places, in the unit that the places of the kernels give; NaN likewise.
        joint_kind: `(J,)` values of `JointKind`.
        order_group: `(J,)` joints of the same number, 0 or more, may change places in the order,
            because their axes coincide or commute, or touches do not tell; -1 where the order is
            known.
        part_link: `(P,)` the joint whose link wears each part, or `BASE`; `UNUSED` if unknown.
        toucher_link: `(U,)` the joint whose link carries each toucher, or `BASE`.
        toucher_place: `(U, 3)` its centre, in the frame of its link.
        toucher_shape: `(U, 5)` its surface, less a ball: coefficients of a support function over
            `SHAPE_BASIS`; zeros for a point or a ball.
        kernel_part: `(K,)` part of each target sensation: those of the graph, the first ones, and
            more where the tree tells skins apart that the graph joins.
        kernel_place: `(K, 3)` place of the toucher's centre there, in the frame of the part's link;
            NaN where unknown.
        kernel_normal: `(K, 3)` outward normal of the skin there; NaN where unknown.
        kernel_toucher: `(R,)` the toucher that made each stored touch; -1 for an outlier.
        receptor_part: `(S,)` part of each receptor; -1 where it was never met.
        receptor_place: `(S, 3)` as in `Receptors`.
        receptor_normal: `(S, 3)` as in `Receptors`.
        receptor_sigma: `(S,)` as in `Receptors`.
        accepted_by_part: `(P,)` bool, whether held-out touches agree with the model.
        reason: why parts were accepted or rejected, in plain sentences with figures.
        held_out: `(P,)` 0 to 1, share of the held-out touches that are no outliers and lie nearer
            to the place of their own kernel than neighbouring kernels lie to each other; NaN if
            nothing was tested.
        inliers: `(P,)` 0 to 1, share of the touches that are no outliers; NaN likewise.
        criterion: `(P,)` held-out log-determinant; lower is better, NaN likewise.
        num_touches: `(P,)` touches of each part that the fit saw.
        dimension: of the space that the model spans: 2 for a chain in a plane, 0 if there is none.
        seed: of the fit.
        version: of these arrays.

    Raises:
        ValueError: arrays disagree; the text names the first that does not fit.
        VersionError: they were made by another version.
    """

    joint_names: tuple[str, ...]
    joint_parent: np.ndarray
    twists: np.ndarray
    twist_sigma: np.ndarray
    covariance: np.ndarray
    joint_kind: np.ndarray
    order_group: np.ndarray
    part_link: np.ndarray
    toucher_link: np.ndarray
    toucher_place: np.ndarray
    toucher_shape: np.ndarray
    kernel_part: np.ndarray
    kernel_place: np.ndarray
    kernel_normal: np.ndarray
    kernel_toucher: np.ndarray
    receptor_part: np.ndarray
    receptor_place: np.ndarray
    receptor_normal: np.ndarray
    receptor_sigma: np.ndarray
    accepted_by_part: np.ndarray
    reason: str
    held_out: np.ndarray
    inliers: np.ndarray
    criterion: np.ndarray
    num_touches: np.ndarray
    dimension: int
    seed: int
    version: int = VERSION

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise VersionError(f"version is {self.version}, expected {VERSION}")
        num_joints, num_parts = len(self.joint_names), len(self.accepted_by_part)
        num_touchers, num_kernels = len(self.toucher_link), len(self.kernel_part)
        num_receptors = len(self.receptor_part)
        num_errors = 6 * num_joints + 3 * num_touchers
        of_joints = ("joint_parent", "joint_kind", "order_group")
        of_parts = ("part_link", "held_out", "inliers", "criterion", "num_touches")
        self.check_arrays(
            {
                **dict.fromkeys(of_joints, (num_joints,)),
                **dict.fromkeys(("twists", "twist_sigma"), (num_joints, 6)),
                "covariance": (num_errors, num_errors),
                "accepted_by_part": (None,),
                **dict.fromkeys(of_parts, (num_parts,)),
                "toucher_link": (None,),
                "toucher_place": (num_touchers, 3),
                "toucher_shape": (num_touchers, 5),
                "kernel_part": (None,),
                **dict.fromkeys(("kernel_place", "kernel_normal"), (num_kernels, 3)),
                "kernel_toucher": (None,),
                "receptor_part": (None,),
                **dict.fromkeys(("receptor_place", "receptor_normal"), (num_receptors, 3)),
                "receptor_sigma": (num_receptors,),
            }
        )
        if len(set(self.joint_names)) < num_joints:
            raise ValueError(f"joint_names are {', '.join(self.joint_names)}: give each once")
        self._check_indices("joint_parent", UNUSED, num_joints)
        self._check_indices("joint_kind", 0, len(JointKind))
        self._check_indices("order_group", -1, num_joints)
        self._check_indices("part_link", UNUSED, num_joints)
        self._check_indices("toucher_link", BASE, num_joints)
        self._check_indices("kernel_part", 0, num_parts)
        self._check_indices("kernel_toucher", -1, num_touchers)
        self._check_indices("receptor_part", -1, num_parts)
        self._check_tree()
        if not np.isfinite(self.twists[self.used]).all():
            raise ValueError("twists must hold finite numbers for joints in use")

    def _check_indices(self, name: str, least: int, end: int) -> None:
        found = getattr(self, name)
        bad = found[(found < least) | (found >= end)]
        if len(bad):
            raise ValueError(f"{name} has {bad[0]}, expected {least} to {end - 1}")

    def _check_tree(self) -> None:
        """Refuses a joint that carries itself, and links of joints that are not used."""
        names = self.joint_names
        if ((self.joint_parent == UNUSED) != (self.joint_kind == JointKind.UNUSED)).any():
            raise ValueError("joint_kind is 0 for exactly the joints whose joint_parent is -2")
        for joint in np.flatnonzero(self.used):
            above = self.joint_parent[joint]
            if above >= 0 and not self.used[above]:
                raise ValueError(f"joint {names[joint]} stands on {names[above]}, which is unused")
            for _ in names:
                above = self.joint_parent[above] if above >= 0 else above
            if above >= 0:
                raise ValueError(f"joint_parent has a ring through joint {names[joint]}")
        for name in ("part_link", "toucher_link"):
            links = getattr(self, name)
            joints = links[links >= 0]
            lost = joints[~self.used[joints]]
            if len(lost):
                raise ValueError(f"{name} names joint {names[lost[0]]}, which is unused")

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Self:
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ValueError: an array is missing or does not fit the others; the text names it.
            VersionError: another version made them.
        """
        found = np.asarray(arrays.get("version", -1))
        if found.shape or found != VERSION:  # Before fields that this version may not have.
            raise VersionError(f"version is {found.tolist()}, expected {VERSION}")
        if "covariance" not in arrays and {"twist_sigma", "toucher_place"} <= arrays.keys():
            # Older files say nothing of how errors go together.
            errors = independent(arrays["twist_sigma"], len(arrays["toucher_place"]))
            arrays = {**arrays, "covariance": errors}
        # Without arguments, super() does not find the class of a dataclass with slots.
        return super(BodyModel, cls).from_arrays(arrays)

    @property
    def accepted(self) -> bool:
        """Whether held-out touches agree with the model on every part."""
        return len(self.accepted_by_part) > 0 and bool(self.accepted_by_part.all())

    @property
    def used(self) -> np.ndarray:
        """`(J,)` bool, joints that matter somewhere."""
        return self.joint_parent != UNUSED

    @property
    def hand_of_toucher(self) -> np.ndarray:
        """`(U,)` the hand that each toucher is of, by number.

        Three points of one link or more are one hand, which is no point; each other is its own.
        """
        _, of_link, number = np.unique(self.toucher_link, return_inverse=True, return_counts=True)
        own = np.where(number[of_link] < BLUNT, -1 - np.arange(len(of_link)), of_link)
        return np.unique(own, return_inverse=True)[1]

    def chain(self, link: int) -> list[int]:
        """The joints from the base to a link, the first one first; none for `BASE`."""
        joints: list[int] = []
        while link >= 0:
            joints.append(link)
            link = int(self.joint_parent[link])
        return joints[::-1]

    def link_poses(self, q: np.ndarray) -> np.ndarray:
        """Poses of all links in the frame of the base.

        Args:
            q: `(n, J)` readings of the joints.

        Returns:
            `(n, J + 1, 4, 4)`, the link of each joint, the base last; NaN for joints not in use.
        """
        q = self._checked_q(q)
        poses = np.full((len(q), len(self.joint_names) + 1, 4, 4), np.nan)
        poses[:, BASE] = np.eye(4)
        own = exponentials(q[:, :, None] * self.twists).reshape(*q.shape, 4, 4)
        carry(own, self._parents_first(), self.joint_parent, poses)
        return poses

    def place(self, q: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Where the toucher's centre is, as seen from a part of the skin.

        Of several touchers it is the one nearest to the place of the target's kernel, measured by
        how far that kernel reaches along the skin and across it. The shape of
        the toucher is accounted for where the skin's normal is known: then it is the centre of a
        ball that touches the skin at the same point.

        Args:
            q: `(n, J)` readings of the joints.
            target: `(n,)` target sensations, which name the parts; with one part and one toucher
                any will do.

        Returns:
            `(n, 3)` in the frame of the link that wears the part, the model's unit of length; NaN
            where the model does not know.

        Raises:
            ValueError: shapes disagree, or there is no such target sensation.
        """
        q, target = self._checked_q(q), np.asarray(target)
        if target.shape != q.shape[:1] or target.dtype.kind not in "iu":
            raise ValueError(
                f"target is {target.dtype} {target.shape}; give {len(q)} whole numbers, one for "
                "each row of q"
            )
        if not 0 <= target.min(initial=0) <= target.max(initial=0) < len(self.kernel_part):
            raise ValueError(f"target must name target sensations 0 to {len(self.kernel_part) - 1}")
        found = np.full((len(q), 3), np.nan)
        part = self.kernel_part[target]
        for number in np.unique(part):
            rows = np.flatnonzero(part == number)
            found[rows] = self._nearest(self._of_touchers(q[rows], target[rows]), target[rows])
        return found

    def touched_by(self, q: np.ndarray, target: np.ndarray) -> np.ndarray:
        """`(n,)` the toucher that comes nearest to the place of the target; -1 if that is unknown.

        Args:
            q: `(n, J)` readings of the joints.
            target: `(n,)` target sensations.
        """
        found = np.full(len(q), -1)
        if len(self.toucher_link) == 0:
            return found
        known = np.isfinite(self.kernel_place[target]).all(axis=1)
        for part in np.unique(self.kernel_part[target[known]]):
            rows = np.flatnonzero(known & (self.kernel_part[target] == part))
            places = self._of_touchers(q[rows], target[rows])
            found[rows] = nearest_toucher(places, self.kernel_place, self.kernel_part, target[rows])
        return found

    def target_at(self, part: int, place: Sequence[float]) -> int:
        """The target sensation that is felt nearest to a place on a part.

        Args:
            part: its number.
            place: `(3,)` in the frame of the part's link, in the model's unit.

        Raises:
            ValueError: there is no such part, it was not accepted, or the place is not finite.
        """
        num_parts = len(self.accepted_by_part)
        if not 0 <= part < num_parts:
            raise ValueError(f"part is {part}; the model has parts 0 to {num_parts - 1}")
        if not self.accepted_by_part[part]:
            raise ValueError(f"part is {part}, of which the agent has no model: {self.reason}")
        if not np.isfinite(place).all():
            raise ValueError(f"place is {list(place)}; give three finite numbers")
        off = np.linalg.norm(self.kernel_place - place, axis=1)
        off[(self.kernel_part != part) | np.isnan(off)] = np.inf
        return int(off.argmin())

    def axis_errors(self, joint: int) -> tuple[float, float]:
        """Standard errors of a joint's axis; NaN where they are unknown.

        Returns:
            Degrees, of its direction, each way across it; and of what the joint does per unit of
            its reading.
        """
        # Of the twist, what says where the axis points.
        own = slice(3, 6) if self.joint_kind[joint] == JointKind.SLIDES else slice(0, 3)
        axis, first = self.twists[joint, own], 6 * joint + own.start
        errors = self.covariance[first : first + 3, first : first + 3]
        size = float(np.linalg.norm(axis))
        if not size or not np.isfinite(errors).all():
            return np.nan, np.nan
        along = max(float(axis @ errors @ axis) / size**2, 0.0)
        across = max(float(np.trace(errors)) - along, 0.0) / 2.0
        return float(np.degrees(np.sqrt(across) / size)), float(np.sqrt(along))

    def receptors(self) -> Receptors:
        """The receptors in the order of the readings."""
        return Receptors(
            place=self.receptor_place,
            normal=self.receptor_normal,
            sigma=self.receptor_sigma,
            part=self.receptor_part,
        )

    def _of_touchers(self, q: np.ndarray, target: np.ndarray) -> np.ndarray:
        """`(U, n, 3)` places of all touchers at `(n,)` targets of one part."""
        wearer = int(self.part_link[self.kernel_part[target[0]]])
        found = np.full((len(self.toucher_link), len(q), 3), np.nan)
        if wearer == UNUSED:
            return found
        for toucher, link in enumerate(self.toucher_link.tolist()):
            there, back = self.between(wearer, link)
            X = chained(self.twists, q, there, back)
            centre = np.broadcast_to(self.toucher_place[toucher], (len(q), 3))
            found[toucher] = transformed(X, centre)
            if self.toucher_shape[toucher].any():
                found[toucher] = self._of_ball(toucher, X, found[toucher], target)
        return found

    def _of_ball(
        self, toucher: int, X: np.ndarray, centre: np.ndarray, target: np.ndarray
    ) -> np.ndarray:
        """`(n, 3)` centres of balls that touch the skin where a toucher with a shape does.

        Args:
            toucher: which.
            X: `(n, 4, 4)` poses of its link in the frame of the skin's link.
            centre: `(n, 3)` places of its centre.
            target: `(n,)` target sensations of one part.
        """
        part = self.kernel_part == self.kernel_part[target[0]]
        place = np.where(part[:, None], self.kernel_place, np.nan)
        near, at = beside(place, self.kernel_part), centre
        # Where it touches depends on its shape, and the other way round.
        for _ in range(2):
            normal = blended_normals(place, self.kernel_normal, near, at)
            # A normal is known where no place is, if a model was made by hand.
            normal = np.where(np.isnan(normal), self.kernel_normal[target], normal)
            away = -np.einsum("nij,nj->ni", transposed(X)[:, :3, :3], normal)
            in_hand = bulge(self.toucher_shape[toucher], away)
            at = centre + np.einsum("nij,nj->ni", X[:, :3, :3], in_hand)
        return at

    def between(self, start: int, end: int) -> tuple[list[int], list[int]]:
        """The joints from one link up, the last one first, and down to another.

        Joints on the way of both from the base cancel.
        """
        up, down = self.chain(start), self.chain(end)
        while up and down and up[0] == down[0]:
            up, down = up[1:], down[1:]
        return up[::-1], down

    def _nearest(self, places: np.ndarray, target: np.ndarray) -> np.ndarray:
        """`(n, 3)` of `(U, n, 3)` places, those nearest to the places of the targets."""
        if len(places) == 0:
            return np.full((len(target), 3), np.nan)
        if len(places) == 1:
            return places[0]
        nearest = nearest_toucher(places, self.kernel_place, self.kernel_part, target)
        found = places[nearest, np.arange(len(target))]
        found[np.isnan(self.kernel_place[target]).any(axis=1)] = np.nan
        return found

    def _parents_first(self) -> np.ndarray:
        used = np.flatnonzero(self.used).tolist()
        return np.array(sorted(used, key=lambda joint: len(self.chain(joint))), dtype=int)

    def _checked_q(self, q: np.ndarray) -> np.ndarray:
        q, num_joints = np.asarray(q, dtype=float), len(self.joint_names)
        if q.ndim != 2 or q.shape[1] != num_joints:
            raise ValueError(f"q has shape {q.shape}, expected (any, {num_joints})")
        return q


def independent(twist_sigma: np.ndarray, num_touchers: int) -> np.ndarray:
    """`(6 J + 3 U, 6 J + 3 U)` covariance of `(J, 6)` errors that know nothing of each other."""
    return np.diag(np.concatenate([np.square(twist_sigma).ravel(), np.zeros(3 * num_touchers)]))


def rejected(
    reason: str,
    *,
    joint_names: Sequence[str],
    kernel_part: np.ndarray,
    num_rows: int,
    num_receptors: int,
    seed: int = 0,
) -> BodyModel:
    """No model: nothing is known, and no part is accepted.

    Args:
        reason: why, in a plain sentence, or `off`.
        joint_names: `(J,)` names of the joints.
        kernel_part: `(K,)` part of each target sensation.
        num_rows: R, stored touches.
        num_receptors: S.
        seed: of the fit that was tried, if any.
    """
    num_joints, num_kernels = len(joint_names), len(kernel_part)
    num_parts = int(np.max(kernel_part, initial=-1)) + 1

    def unknown(*shape: int) -> np.ndarray:
        return np.full(shape, np.nan)

    return BodyModel(
        joint_names=tuple(joint_names),
        joint_parent=np.full(num_joints, UNUSED),
        twists=np.zeros((num_joints, 6)),
        twist_sigma=unknown(num_joints, 6),
        covariance=unknown(6 * num_joints, 6 * num_joints),
        joint_kind=np.full(num_joints, int(JointKind.UNUSED)),
        order_group=np.full(num_joints, -1),
        part_link=np.full(num_parts, UNUSED),
        toucher_link=np.zeros(0, dtype=int),
        toucher_place=np.zeros((0, 3)),
        toucher_shape=np.zeros((0, 5)),
        kernel_part=np.asarray(kernel_part),
        kernel_place=unknown(num_kernels, 3),
        kernel_normal=unknown(num_kernels, 3),
        kernel_toucher=np.full(num_rows, -1, dtype=np.int8),
        receptor_part=np.full(num_receptors, -1),
        receptor_place=unknown(num_receptors, 3),
        receptor_normal=unknown(num_receptors, 3),
        receptor_sigma=unknown(num_receptors),
        accepted_by_part=np.zeros(num_parts, dtype=bool),
        reason=reason,
        held_out=unknown(num_parts),
        inliers=unknown(num_parts),
        criterion=unknown(num_parts),
        num_touches=np.zeros(num_parts, dtype=int),
        dimension=0,
        seed=seed,
    )
