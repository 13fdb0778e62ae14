"""A body model in words and tables, for the terminal and the report."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.model import BASE, UNUSED, BodyModel, JointKind
from selftouch_drake.agent.representation.quotient import LEAST_OF_PART

#: What a body model assumes, named each time that one is used.
ASSUMPTION = "rigid links on joints that turn or slide"

#: What touch cannot tell, of any body.
UNKNOWABLE = (
    "one length (the model has a unit of its own), the mirror image, how deep under the skin the "
    "toucher's centre passes, and which link stands still"
)

JOINT_COLUMNS: tuple[str, ...] = (
    "joint",
    "kind",
    "axis",
    "per reading",
    "order",
    "standard error",
    "open",
)
PART_COLUMNS: tuple[str, ...] = (
    "part of the skin",
    "judgement",
    "held-out touches",
    "no outliers",
    "criterion",
    "touches",
)

_KINDS = {
    JointKind.UNUSED: "not used",
    JointKind.TURNS: "turns",
    JointKind.SLIDES: "slides",
    JointKind.OPEN: "turns or slides",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelText:
    """A body model in words.

    Attributes:
        verdict: whether it was accepted, in a few words.
        sentences: what was assumed, how it was tested, why it was accepted or not, what is unknown.
        joints: a row for each joint, under `JOINT_COLUMNS`.
        parts: a row for each part of the skin, under `PART_COLUMNS`.
        tree: lines that draw the tree of joints; none without joints.
    """

    verdict: str
    sentences: Sequence[str]
    joints: Sequence[tuple[str, ...]]
    parts: Sequence[tuple[str, ...]]
    tree: Sequence[str]


def is_off(model: BodyModel) -> bool:
    """Whether the agent was not asked for a model at all."""
    return model.reason == "off"


def model_text(model: BodyModel) -> ModelText:
    """Puts a model into words."""
    return ModelText(
        verdict=verdict(model),
        sentences=_sentences(model),
        joints=[_joint_row(model, joint) for joint in range(len(model.joint_names))],
        parts=[_part_row(model, part) for part in range(len(model.accepted_by_part))],
        tree=_tree(model),
    )


def verdict(model: BodyModel) -> str:
    """Whether a model was accepted, in a few words."""
    if is_off(model):
        return "off"
    accepted = int(model.accepted_by_part.sum())
    # Fragments have no shape, and no report counts them as parts.
    sizes = np.bincount(model.kernel_part, minlength=len(model.accepted_by_part))
    num_parts = int(np.sum((sizes >= LEAST_OF_PART) | model.accepted_by_part))
    if model.accepted:
        return "accepted"
    if accepted == num_parts > 0:
        return "accepted on all parts but fragments"
    return f"accepted on {accepted} of {num_parts} parts" if accepted else "rejected"


def headline(model: BodyModel) -> str:
    """A model in one line."""
    if is_off(model):
        return "off"
    if not model.accepted_by_part.any():
        told = model.reason.startswith("rejected")
        return model.reason if told else f"rejected: {model.reason}"
    kinds = model.joint_kind[model.used]
    counts = [
        f"{number} {_plural('joint', number)} {word if number > 1 else word + 's'}"
        for kind, word in ((JointKind.TURNS, "turn"), (JointKind.SLIDES, "slide"))
        if (number := int(np.sum(kinds == kind)))
    ]
    if number := int(np.sum(kinds == JointKind.OPEN)):
        counts.append(f"{number} {'turns or slides' if number == 1 else 'turn or slide'}")
    held_out = np.nanmin(model.held_out[model.accepted_by_part])
    return (
        f"{verdict(model)}: {', '.join(counts)}; {held_out:.0%} of the held-out touches agree with "
        f"{ASSUMPTION}"
    )


def _sentences(model: BodyModel) -> list[str]:
    if is_off(model):
        return ["The agent was not asked for a body model: representation.body_model is off."]
    found = [
        f"Assumed: {ASSUMPTION}. Tested on touches that the fit did not see.",
        model.reason,
    ]
    if not model.accepted:
        found.append(
            "Where the model was not accepted, the agent relies on the quotient representation "
            "alone."
        )
    if model.accepted_by_part.any():
        met, num_receptors = int(np.sum(model.receptor_part >= 0)), len(model.receptor_part)
        found.append(
            f"The model spans a space of {model.dimension} dimensions, and has places for {met} of "
            f"{num_receptors} receptors."
        )
        found.append(f"Touch cannot tell: {UNKNOWABLE}.")
    return found


def _joint_row(model: BodyModel, joint: int) -> tuple[str, ...]:
    kind, name = JointKind(model.joint_kind[joint]), model.joint_names[joint]
    if kind == JointKind.UNUSED:
        return name, _KINDS[kind], *[""] * (len(JOINT_COLUMNS) - 2)
    # Of the twist, what says where the axis points.
    columns = slice(3, 6) if kind == JointKind.SLIDES else slice(0, 3)
    along = model.twists[joint, columns]
    size = float(np.linalg.norm(along))
    direction = along / size if size else np.full(3, np.nan)
    across_deg, per_reading = model.axis_errors(joint)
    above = int(model.joint_parent[joint])
    unit = "" if kind == JointKind.SLIDES else " rad"
    return (
        name,
        _KINDS[kind],
        " ".join(f"{x:+.3f}" for x in direction) if size else "",
        f"{size:.4g}{'' if np.isnan(per_reading) else f' ± {per_reading:.1g}'}{unit}",
        "on the base" if above == BASE else f"after {model.joint_names[above]}",
        "unknown" if np.isnan(across_deg) else f"{across_deg:.2g}°",
        _open(model, joint),
    )


def _open(model: BodyModel, joint: int) -> str:
    """What the touches leave open about a joint; empty if nothing."""
    found = []
    if model.joint_kind[joint] == JointKind.OPEN:
        found.append("kind")
    if not np.isfinite(model.twist_sigma[joint]).all():
        found.append("axis")
    group = model.order_group[joint]
    others = np.flatnonzero((model.order_group == group) & (group >= 0))
    names = [model.joint_names[other] for other in others if other != joint]
    if names:
        found.append(f"order with {', '.join(names)}")
    return ", ".join(found)


def _part_row(model: BodyModel, part: int) -> tuple[str, ...]:
    def share(value: float) -> str:
        return "" if np.isnan(value) else f"{value:.1%}"

    criterion = model.criterion[part]
    return (
        str(part),
        "accepted" if model.accepted_by_part[part] else "rejected",
        share(model.held_out[part]),
        share(model.inliers[part]),
        "" if np.isnan(criterion) else f"{criterion:.2f}",
        f"{int(model.num_touches[part]):,}",
    )


def _tree(model: BodyModel) -> list[str]:
    """The joints from the base outward; where the tree does not branch, on one line."""
    if not model.used.any():
        return []
    children = defaultdict[int, list[int]](list)
    for joint in np.flatnonzero(model.used):
        children[int(model.joint_parent[joint])].append(int(joint))
    worn = _things_on_links(model)
    base = f"base{_in_brackets(worn[BASE])}"
    return [base, *_branches(model, children, worn, BASE, "")]


def _branches(
    model: BodyModel,
    children: dict[int, list[int]],
    worn: dict[int, list[str]],
    link: int,
    indent: str,
) -> list[str]:
    lines = []
    for joint in children[link]:
        is_last = joint == children[link][-1]
        chain = [joint]
        while len(children[chain[-1]]) == 1 and not worn[chain[-1]]:
            chain.append(children[chain[-1]][0])
        names = " > ".join(model.joint_names[each] for each in chain)
        lines.append(f"{indent}{'└─' if is_last else '├─'} {names}{_in_brackets(worn[chain[-1]])}")
        deeper = f"{indent}{'   ' if is_last else '│  '}"
        lines += _branches(model, children, worn, chain[-1], deeper)
    return lines


def _things_on_links(model: BodyModel) -> dict[int, list[str]]:
    """What each link wears and carries, in words."""
    worn = defaultdict[int, list[str]](list)
    for part, link in enumerate(model.part_link.tolist()):
        if link != UNUSED:
            worn[link].append(f"wears part {part}")
    for link in np.unique(model.toucher_link).tolist():
        touchers = np.flatnonzero(model.toucher_link == link)
        listed = ", ".join(str(toucher) for toucher in touchers)
        worn[link].append(f"touches with {_plural('toucher', len(touchers))} {listed}")
    return worn


def _in_brackets(words: list[str]) -> str:
    return f" ({', '.join(words)})" if words else ""


def _plural(word: str, number: int) -> str:
    return word if number == 1 else f"{word}s"
