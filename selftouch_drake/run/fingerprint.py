"""Short texts that identify everything that decides the experience of a run.

The content of models and meshes counts, not their path: a run may move to another machine, and an
edited model cannot mix two robots in one store.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from selftouch_drake.bodies.own import body_files
from selftouch_drake.experiment import Experiment, ExperimentError, shown
from selftouch_drake.experiment.schema import ReadingSettings
from selftouch_drake.files import content_digest

# The fields of `execution` that decide how the joints follow the walk.
_CONTROLLER = ("time_step", "stiffness", "damping")

# Fields that older versions did not know, with their defaults.
_NEWER_OF_SKINS = {"receptors": None, "reading": dataclasses.asdict(ReadingSettings())}
_NEWER_OF_BABBLING = {"strategy": "random", "jumps": True, "robot_hours": None, "seek": "receptors"}

#: SHA-256 of the content of each file that decides the robot and its skins, by its path.
Digests = Mapping[str, str]


def model_digests(
    experiment: Experiment, announce: Callable[[str], None] | None = None
) -> dict[str, str]:
    """Digests of every file that decides the robot and its skins, as it is now.

    Errors and `announce` are as in `body_files`; an ExperimentError names a missing file of a skin.
    """
    files = body_files(experiment, announce)
    of_skins = _skin_files(experiment)
    for (name, *field), file in of_skins.items():
        if not file.is_file():
            raise ExperimentError(
                f"{'.'.join(('skins', name, *field))} is {shown(str(file))}; there is no such "
                "file: correct the path"
            )
    return {str(file): content_digest(file) for file in [*files, *of_skins.values()]}


def experience_fingerprint(experiment: Experiment, digests: Digests) -> str:
    """Identifies what decides the experience: seed, robot, skins, what touches and babbling.

    Noise of the joints and changes of the body count if there are any, and under dynamics the joint
    controllers do. The digests are those of `model_digests`.
    """
    fields = dataclasses.asdict(experiment)
    kept: dict[str, Any] = {
        "seed": fields["seed"],
        "babbling": _without_defaults(fields["babbling"], _NEWER_OF_BABBLING),
        "models": list(digests.values()),
        "robot": {key: fields["robot"][key] for key in ("joints", "collision_depth")},
        # Their order counts: that of the readings in a sensation, and of the numbers in the truth.
        "skins": list(_skins(experiment, fields["skins"], digests).items()),
        "touching": list(fields["touching"].items()),
    }
    if experiment.imported is not None:
        kept["imported"] = experiment.imported.content
    for name, path in (("python", "file"), ("gymnasium", "env")):
        if (body := fields[name]) is not None:
            # A file counts by its content, which is among the models.
            kept[name] = body | ({path: Path(body[path]).name} if digests else {})
            kept[name].pop("timeout_s", None)
    if experiment.joints.noise:
        kept["joints"] = experiment.joints.noise
    if experiment.changes:
        kept["changes"] = fields["changes"]
    if experiment.babbling.mode == "dynamic":
        kept["controller"] = {key: fields["execution"][key] for key in _CONTROLLER}
    return fingerprint_of(kept)


def _skins(
    experiment: Experiment, skins: dict[str, dict[str, Any]], digests: Digests
) -> dict[str, dict[str, Any]]:
    """The fields of skins, with the digests of their files in the place of their paths."""
    for (name, part, field), file in _skin_files(experiment).items():
        skins[name][part][field] = digests.get(str(file))
    return {name: _without_defaults(skin, _NEWER_OF_SKINS) for name, skin in skins.items()}


def _without_defaults(fields: dict[str, Any], newer: Mapping[str, Any]) -> dict[str, Any]:
    """The fields without newer ones that have their default, because older runs have none."""
    return {
        name: value for name, value in fields.items() if name not in newer or value != newer[name]
    }


def _skin_files(experiment: Experiment) -> dict[tuple[str, str, str], Path]:
    """The files of skins, by the skin's name and the field."""
    files = {}
    for name, skin in experiment.skins.items():
        if skin.surface.mesh is not None:
            files[name, "surface", "mesh"] = Path(skin.surface.mesh)
        if skin.receptors is not None:
            files[name, "receptors", "file"] = Path(skin.receptors.file)
    return files


def fingerprint_of(fields: Any) -> str:
    """Identifies fields by a short text."""
    return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:16]
