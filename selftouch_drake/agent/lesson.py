"""A lesson: what touches have told of a body so far, and what to touch and move next (naive).

Pure functions of the touches alone. They suggest joints of which little was seen and receptors that
felt little; they do not plan motions.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.body_model import few
from selftouch_drake.agent.body_model.felt_twice import from_one_side, without_last
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.model import BodyModel, JointKind
from selftouch_drake.agent.body_model.one_limb import Moved, moved_together
from selftouch_drake.quotient.sensations import assign, target_sensations

# Touches of a target sensation, at least, and the most targets.
_PER_TARGET, _MOST_TARGETS = 3, 150
# Receptors whose touches have at least this cosine are of one part; smaller parts of the touches
# are left to the others; and parts are told from this many touches on, or from fewer that limbs
# made in turn.
_ALIKE, _PART, _PARTS_FROM, _OF_LIMBS_FROM = 0.2, 0.03, 800, 300
# A joint was seen if touches cover this share of its range.
_SEEN = 0.4
# Fewer touches make no representation, though a body may be known.
_LEAST = 300
# A receptor was felt by so many touches, and enough receptors are this share.
_FELT, _ENOUGH_FELT = 3, 0.9
# A joint is known if the standard error of its axis, in degrees, is below this.
_KNOWN_DEG = 3.0
# Joints and receptors that one step names.
_NAMED = 5
# A limb touched a part on purpose if it made so many of its touches, and this share of what each
# limb would make if all made as many: a forearm that moves against another hand does so by chance.
_ON_PURPOSE, _SHARE = 4, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class JointKnown:
    """What is known of a joint.

    Attributes:
        name: of the joint.
        seen: 0 to 1, share of its range that touches cover.
        kind: what it does, in a word or two.
        error_deg: standard error of its axis; NaN where unknown.
    """

    name: str
    seen: float
    kind: str
    error_deg: float

    @property
    def is_known(self) -> bool:
        """Whether its axis is."""
        # Of an axis that touches leave open, there is no error to wait for.
        return self.kind != "unknown" and not self.error_deg > _KNOWN_DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class PartKnown:
    """What is known of receptors that feel the same touches.

    Attributes:
        receptors: numbers of those that were felt, the least felt first.
        num_touches: on them; by `limb`, if there is one.
        limb: of the joints that touched there while others stood still, those that did least
            often; nothing if none did.
    """

    receptors: Sequence[int]
    num_touches: int
    limb: Sequence[int] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """What is known of a body.

    Attributes:
        num_touches: so far.
        joints: one for each.
        parts: of the skin that was felt, the least touched first.
        limbs: sets of joints that moved while others stood still.
        felt: `(S,)` touches that each receptor felt.
        names: S of them.
        accepted: whether touches that were left out agree with a body model.
        reason: why or why not, in a sentence.
    """

    num_touches: int
    joints: Sequence[JointKnown]
    felt: np.ndarray
    names: Sequence[str]
    parts: Sequence[PartKnown] = ()
    limbs: Sequence[Sequence[int]] = ()
    accepted: bool
    reason: str

    @property
    def share_felt(self) -> float:
        """0 to 1, receptors that felt enough."""
        return float(np.mean(self.felt >= _FELT))

    @property
    def is_enough(self) -> bool:
        """Whether the body is accepted, every joint known and nearly every receptor felt."""
        return (
            self.accepted
            and self.num_touches >= _LEAST
            and self.share_felt >= _ENOUGH_FELT
            and all(joint.is_known for joint in self.joints)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What to do next.

    Attributes:
        text: a sentence for a person.
        joints: numbers of the joints to move.
        receptors: numbers of the receptors to touch.
    """

    text: str
    joints: Sequence[int] = ()
    receptors: Sequence[int] = ()


def ask(
    q: np.ndarray,
    sensation: np.ndarray,
    joint_names: Sequence[str],
    *,
    seed: int = 0,
    each: Callable[..., Iterable] = map,
) -> BodyModel | None:
    """The body model of `(n, J)` configurations and `(n, S)` touches; None if they are too few.

    Of touches that a hand feels, too, the other side is explained, and the hand is a point.
    """
    if len(q) < few.FEWEST:
        return None
    readings = np.maximum(sensation, 0).astype(np.float32)
    side = from_one_side(readings)
    if side is None or len(side.row) < few.FEWEST:
        return _asked(q, readings, joint_names, seed, each)
    added = side.along.shape[1]
    names = [*joint_names, *(f"{joint_names[0]} along {n}" for n in range(added))]
    q = np.hstack([q[side.row], side.along])
    model = _asked(q, side.sensation, names, seed, each, along=added)
    return without_last(model, added)


def _asked(
    q: np.ndarray,
    readings: np.ndarray,
    joint_names: Sequence[str],
    seed: int,
    each: Callable[..., Iterable],
    along: int = 0,
) -> BodyModel:
    """The body model of touches that one side felt.

    One part of skin is tried first, and several only where that is rejected.
    """
    number = min(len(q) // _PER_TARGET, _MOST_TARGETS)
    targets = target_sensations(readings, number, or_fewer=True)
    label, _ = assign(readings, targets)

    def find(part: np.ndarray) -> BodyModel:
        return find_body_model(
            q,
            csr_array(readings),
            label,
            part,
            joint_names=joint_names,
            along=along,
            seed=seed,
            each=each,  # type: ignore[arg-type]
        )

    several = len(moved_together(q).sets) > 1
    if len(q) >= (_OF_LIMBS_FROM if several else _PARTS_FROM):
        parts = _parts(readings)[targets.argmax(axis=1)]
        if parts.any():
            return find(parts)
    return find(np.zeros(len(targets), dtype=int))


def known(
    q: np.ndarray,
    sensation: np.ndarray,
    joint_names: Sequence[str],
    receptor_names: Sequence[str],
    reach: np.ndarray,
    model: BodyModel | None,
) -> Known:
    """What is known.

    Args:
        q: `(n, J)` configurations of the touches.
        sensation: `(n, S)` what was felt.
        joint_names: J.
        receptor_names: S.
        reach: `(2, J)` limits of the joints, or how far they were seen to move without a touch.
        model: of these touches or of earlier ones.
    """
    span = np.maximum(reach[1] - reach[0], 1e-12)
    seen = np.clip(np.ptp(q, axis=0) / span, 0, 1) if len(q) else np.zeros(len(joint_names))
    joints = [
        JointKnown(name=name, seen=float(seen[n]), **_of_model(model, n))
        for n, name in enumerate(joint_names)
    ]
    reason = "too few touches to look for a body" if model is None else model.reason
    moved = moved_together(q) if len(q) else Moved([], np.zeros(0, dtype=int))
    return Known(
        num_touches=len(q),
        joints=joints,
        felt=np.count_nonzero(sensation > 0, axis=0),
        names=receptor_names,
        parts=_parts_known(sensation, moved),
        limbs=moved.sets,
        accepted=model is not None and model.accepted,
        reason=reason,
    )


def next_steps(found: Known) -> list[Step]:
    """What to do next, the most urgent first; nothing if it is enough."""
    if found.is_enough:
        return []
    if found.num_touches == 0:
        return [
            Step(
                text="touch the skin anywhere, gently, and hold still for a moment; of several "
                "limbs move one at a time, for ten touches or more"
            )
        ]
    steps = []
    still = [n for n, joint in enumerate(found.joints) if joint.seen < _SEEN]
    if still:
        still.sort(key=lambda n: found.joints[n].seen)
        said = ", ".join(
            f"{found.joints[n].name} ({found.joints[n].seen:.0%} of its range seen)"
            for n in still[:_NAMED]
        )
        steps.append(Step(text=f"touch with other positions of {said}", joints=still[:_NAMED]))
    unsure = [
        n
        for n, joint in enumerate(found.joints)
        if n not in still and not joint.is_known and np.isfinite(joint.error_deg)
    ]
    if unsure:
        unsure.sort(key=lambda n: -found.joints[n].error_deg)
        said = ", ".join(
            f"{found.joints[n].name} (axis ± {found.joints[n].error_deg:.1f}°)"
            for n in unsure[:_NAMED]
        )
        steps.append(Step(text=f"move {said} between touches of one place", joints=unsure[:_NAMED]))
    rare = np.argsort(found.felt, kind="stable")
    rare = rare[found.felt[rare] < _FELT]
    if len(rare) and found.share_felt < _ENOUGH_FELT:
        said = ", ".join(f"{found.names[n]} ({found.felt[n]})" for n in rare[:_NAMED])
        more = f" and {len(rare) - _NAMED} more" if len(rare) > _NAMED else ""
        steps.append(
            Step(
                text=f"touch receptors that felt less than {_FELT} touches: {said}{more}",
                receptors=rare[:_NAMED].tolist(),
            )
        )
    if not found.accepted:
        steps += _of_rarest_part(found)
    if not steps:
        steps.append(Step(text="go on: touch all over, each place with several postures"))
    return steps


def _of_rarest_part(found: Known) -> list[Step]:
    """Of several parts, the one with the fewest touches, and which joints to move alone."""
    if len(found.parts) < 2:
        return []
    part = found.parts[0]
    said = ", ".join(found.names[n] for n in part.receptors[:_NAMED])
    text = f"touch near {said}, the part of the skin with the fewest touches ({part.num_touches})"
    if part.limb:
        moving = ", ".join(found.joints[n].name for n in part.limb)
        text += f"; move {moving} alone, and hold the other joints still for ten touches"
    elif len(found.limbs) < 2:
        text += "; move one limb at a time, and hold the other joints still for ten touches"
    return [Step(text=text, joints=part.limb, receptors=part.receptors)]


def _of_model(model: BodyModel | None, joint: int) -> dict:
    """Kind and error of a joint."""
    if model is None or not model.accepted:
        return {"kind": "unknown", "error_deg": np.nan}
    kind = JointKind(int(model.joint_kind[joint]))
    said = {
        JointKind.UNUSED: "not used",
        JointKind.TURNS: "turns",
        JointKind.SLIDES: "slides",
        JointKind.OPEN: "turns or slides",
    }[kind]
    return {"kind": said, "error_deg": model.axis_errors(joint)[0]}


def _parts_known(sensation: np.ndarray, moved: Moved) -> list[PartKnown]:
    """Parts of the receptors that were felt, the least touched first."""
    if not len(sensation):
        return []
    felt = np.count_nonzero(sensation > 0, axis=0)
    label = _felt_together(sensation)
    of_touch = label[sensation.argmax(axis=1)]
    found, number_on = np.unique(of_touch, return_counts=True)
    by = np.array(
        [
            [np.count_nonzero((of_touch == part) & (moved.of_touch == n)) for part in found]
            for n in range(len(moved.sets))
        ]
    ).reshape(len(moved.sets), len(found))
    able = _able(by, number_on)
    parts = []
    for column, part in enumerate(found):
        own = np.flatnonzero((label == part) & (felt > 0))
        limb: Sequence[int] = ()
        number = int(number_on[column])
        of_able = np.flatnonzero(able[:, column])
        if len(of_able):
            least = int(of_able[by[of_able, column].argmin()])
            limb, number = moved.sets[least], int(by[least, column])
        rare_first = own[np.argsort(felt[own], kind="stable")].tolist()
        parts.append(PartKnown(receptors=rare_first, num_touches=number, limb=limb))
    return sorted(parts, key=lambda one: one.num_touches)


def _able(by: np.ndarray, number: np.ndarray) -> np.ndarray:
    """`(L, P)` bool, which of L limbs touch which part on purpose.

    Limbs are joined where two touch one part. While there is no such part, it is the one that a
    second limb touched most.

    Args:
        by: `(L, P)` touches of each limb on each part.
        number: `(P,)` touches of each part.
    """
    able = by >= np.maximum(_ON_PURPOSE, _SHARE * number / max(len(by), 1))
    if len(by) > 1 and able.sum(axis=0).max() < 2:
        second = np.sort(by, axis=0)[-2]
        part = int(second.argmax())
        if second[part] >= _ON_PURPOSE:
            able[:, part] |= by[:, part] >= second[part]
    return able


def _felt_together(sensation: np.ndarray) -> np.ndarray:
    """`(S,)` the same number for receptors that feel the same touches."""
    active = (sensation > 0).astype(float)
    norm = np.maximum(np.linalg.norm(active, axis=0), 1e-12)
    # One touch of two parts at once joins nothing.
    shared = np.maximum(active.T @ active - 1, 0)
    return connected_components(shared >= _ALIKE * np.outer(norm, norm))[1]


def _parts(sensation: np.ndarray) -> np.ndarray:
    """`(S,)` the part of each receptor, 0 the largest: receptors that feel the same touches."""
    label = _felt_together(sensation)
    weight = np.bincount(label[sensation.argmax(axis=1)], minlength=label.max() + 1)
    order = np.argsort(-weight, kind="stable")
    number = np.zeros(len(order), dtype=int)
    for place, part in enumerate(order.tolist()):
        number[part] = place if weight[part] >= _PART * len(sensation) else 0
    return number[label]
