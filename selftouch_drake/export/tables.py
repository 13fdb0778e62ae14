"""What a file of a robot has no place for, as rows of CSV: scales, standard errors, taxels."""

from collections.abc import Sequence

import numpy as np

from selftouch_drake.agent.body_model.model import BodyModel, JointKind
from selftouch_drake.export.link_tree import joint_scales

JOINT_COLUMNS = ("joint", "kind", "scale", "offset", "lower", "upper", "sigma", "used")
RECEPTOR_COLUMNS = ("name", "part", "x", "y", "z", "nx", "ny", "nz", "sigma")


def joint_rows(
    model: BodyModel, slides: np.ndarray, limits: tuple[np.ndarray, np.ndarray]
) -> list[tuple[str, ...]]:
    """A row for each joint, under `JOINT_COLUMNS`.

    Reading q of the robot is `scale * q + offset` in the file, rad or its unit of length; `lower`
    and `upper` are limits there, and `sigma` is the standard error of `scale`.

    Arguments are as in `link_tree`.
    """
    scales = joint_scales(model, slides)
    rows: list[tuple[str, ...]] = []
    for joint, name in enumerate(model.joint_names):
        columns = slice(3, 6) if slides[joint] else slice(0, 3)
        along = model.twists[joint, columns] / scales[joint]
        sigma = float(np.sqrt(np.square(along) @ np.square(model.twist_sigma[joint, columns])))
        rows.append(
            (
                name,
                JointKind(model.joint_kind[joint]).name.lower(),
                _number(scales[joint]),
                "0.0",
                _number(limits[0][joint]),
                _number(limits[1][joint]),
                _number(sigma if model.used[joint] else np.nan),
                "true" if model.used[joint] else "false",
            )
        )
    return rows


def receptor_rows(
    model: BodyModel, names: Sequence[str], parts: Sequence[int], depth: float = 0.0
) -> list[tuple[str, ...]]:
    """A row for each receptor in reading order, under `RECEPTOR_COLUMNS`.

    Places and normals are in the frame of the link `part_K`; nothing where a receptor was never met
    or its part is not among `parts`. `depth` is as in `part_surface`.
    """
    rows: list[tuple[str, ...]] = []
    for number, name in enumerate(names):
        part = int(model.receptor_part[number])
        if part not in parts or not np.isfinite(model.receptor_place[number]).all():
            rows.append((name, *[""] * (len(RECEPTOR_COLUMNS) - 1)))
            continue
        normal = model.receptor_normal[number]
        place = model.receptor_place[number] + depth * np.nan_to_num(normal)
        values = (*place, *normal, model.receptor_sigma[number])
        rows.append((name, str(part), *map(_number, values)))
    return rows


def _number(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))
