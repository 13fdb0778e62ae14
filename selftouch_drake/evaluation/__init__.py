"""Scores of the agent against the truth; the only package that reads both sides."""

from selftouch_drake.evaluation.coverage import coverage, touch_density
from selftouch_drake.evaluation.motion import (
    MotionScore,
    calibration,
    cosine_distance,
    progress_along,
    score_motion,
    spatial_jerk_reduction,
    summarise,
    time_off_skin,
    wall_points,
)
from selftouch_drake.evaluation.shape import (
    Distortion,
    align,
    distance_distortion,
    kernel_positions,
    kernel_spread,
    neighbour_agreement,
    shape_rms_fraction,
    trustworthiness,
)
from selftouch_drake.evaluation.surface import surface_distances

__all__ = [
    "Distortion",
    "MotionScore",
    "align",
    "calibration",
    "cosine_distance",
    "coverage",
    "distance_distortion",
    "kernel_positions",
    "kernel_spread",
    "neighbour_agreement",
    "progress_along",
    "score_motion",
    "shape_rms_fraction",
    "spatial_jerk_reduction",
    "summarise",
    "surface_distances",
    "time_off_skin",
    "touch_density",
    "trustworthiness",
    "wall_points",
]
