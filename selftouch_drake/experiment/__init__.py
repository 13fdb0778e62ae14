"""The experiment: what decides a run, its fields and their ranges, and how it is loaded."""

from selftouch_drake.experiment.errors import ExperimentError, closest, shown
from selftouch_drake.experiment.loading import (
    dump_experiment,
    experiment_from_fields,
    load_experiment,
    skins_from_fields,
)
from selftouch_drake.experiment.schema import Experiment, Skin

__all__ = [
    "Experiment",
    "ExperimentError",
    "Skin",
    "closest",
    "dump_experiment",
    "experiment_from_fields",
    "load_experiment",
    "shown",
    "skins_from_fields",
]
