"""Names that joints, readings, times and episodes usually have in recordings."""

import re
from collections.abc import Iterable, Sequence

from selftouch_drake.experience.units import named, plain_form

#: Default names, tried in order; `#` stands for a number, one column for each, and `*` for words.
#: Capitals, blanks, points, brackets and units do not matter: `Q [3]`, `q.3` and `q_3 [rad]` are
#: `q_3`.
Q_NAMES = (
    *("q", "observation.state", "state", "joint_positions", "q_#", "joint_#", "joint#", "q#"),
    *("joint_positions_#", "joint_position_#", "joint_#_pos", "joint_#_position"),
    *(
        "qpos",
        "joint_pos",
        "joint_position",
        "joint_state",
        "joint_states",
        "qpos_#",
        "joint_pos_#",
    ),
    *("field.position#", "joint_states.*.position", "joint_*_pos", "*_joint_pos"),
    *("joint_*_position", "*_joint_position"),
)
SENSATION_NAMES = (
    *("sensation", "observation.touch", "observation.tactile", "observation.skin"),
    *("touch", "tactile", "taxels", "skin", "readings"),
    *("taxel_#", "sensation_#", "touch_#", "tactile_#", "taxel#", "taxels_#", "skin_#"),
    *("*_taxel_#", "taxel_#_#"),
    *("observation.tactile.*", "observation.touch.*", "observation.skin.*"),
    *("tactile.data.#", "skin.data.#", "touch.data.#", "field.data#"),
)
#: Arrays of an archive that name the joints or receptors.
NAMES_OF = {
    "--q": ("joint_names", "joints"),
    "--sensation": ("receptor_names", "taxel_names", "receptors"),
}
TIME_NAMES = (
    *("time_s", "time", "timestamp", "t", "timestamps", "stamp", "header.stamp"),
    *("field.header.stamp", "__time"),
)
EPISODE_NAMES = ("episode_index", "episode", "walk")
#: How a pattern for an option is written, as in errors.
PATTERNS = {"--q": "joint*", "--sensation": "taxel*"}
#: Names, or parts of names, of what is recorded of a joint beside its position.
NO_POSITION = re.compile(
    r"(?:^|[_\W])(d?q?vel|velocity|velocities|speed|qd|dq|acc|acceleration|effort|torque|tau|current"
    r"|cmd|command|commanded|desired|setpoint|goal|target|error|temp|temperature)s?(?:$|[_\W\d])",
    re.IGNORECASE,
)
#: Groups of an archive that hold no measurement.
NO_MEASUREMENT = re.compile(
    r"(^|[_/.])(action|actions|command|commands|desired|target|goal|leader|master|next)([_/.]|$)",
    re.IGNORECASE,
)


def of_usual_name(columns: Iterable[str], defaults: Sequence[str]) -> list[str]:
    """The columns with the first of some names that exists; none if none does."""
    forms = {column: plain_form(column) for column in columns}
    for name in defaults:
        if name in forms:
            return [name]
        pattern = _pattern(plain_form(name))
        matching = [column for column, form in forms.items() if re.fullmatch(pattern, form)]
        exact = _pattern(name)
        if any(re.fullmatch(exact, column) for column in matching):
            # Names that are written as usual come before their variants.
            matching = [column for column in matching if re.fullmatch(exact, named(column).bare)]
        if matching:
            return sorted(matching, key=in_order_of_numbers)
    return []


def at_a_usual_end(columns: Iterable[str], defaults: Sequence[str]) -> list[str]:
    """The columns within groups whose last part has the first of some names that exists.

    Only measurements count: `obs/qpos` does, `action/qpos` does not.
    """
    ends: dict[str, list[str]] = {}
    for column in columns:
        parts = re.split(r"[/.]", column.strip("/."))
        group, end = "/".join(parts[:-1]), parts[-1]
        if group and not NO_MEASUREMENT.search(group):
            ends.setdefault(end, []).append(column)
    found = of_usual_name(ends, defaults)
    return sorted((column for end in found for column in ends[end]), key=in_order_of_numbers)


def _pattern(name: str) -> str:
    return re.escape(name).replace(r"\#", r"\d+").replace(r"\*", r"\w+")


def in_order_of_numbers(name: str) -> list[tuple[int, str]]:
    """Names in the order of their numbers: joint_2 before joint_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
