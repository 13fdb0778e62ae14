"""Scores of the agent against the truth; the only package that reads both sides."""

from selftouch_drake.evaluation.coverage import coverage, touch_density
from selftouch_drake.evaluation.kernels import KernelTruth, kernel_truth
from selftouch_drake.evaluation.motion import (
    MotionScore,
    calibration,
    contact_along,
    cosine_distance,
    in_link_frames,
    jerk_reduction,
    limit_shares,
    off_skin,
    progress_along,
    random_pairs,
    score_motion,
    spatial_jerk_reduction,
    summarise,
)
from selftouch_drake.evaluation.parts import TouchCounts, TruePart, count_touches, true_parts
from selftouch_drake.evaluation.shape import (
    align,
    distance_distortion,
    neighbour_agreement,
    parts_on_skins,
    shape_errors,
    shape_rms_fraction,
    trustworthiness,
)

__all__ = [
    "KernelTruth",
    "MotionScore",
    "TouchCounts",
    "TruePart",
    "align",
    "calibration",
    "contact_along",
    "cosine_distance",
    "count_touches",
    "coverage",
    "distance_distortion",
    "in_link_frames",
    "jerk_reduction",
    "kernel_truth",
    "limit_shares",
    "neighbour_agreement",
    "off_skin",
    "parts_on_skins",
    "progress_along",
    "random_pairs",
    "score_motion",
    "shape_errors",
    "shape_rms_fraction",
    "spatial_jerk_reduction",
    "summarise",
    "touch_density",
    "true_parts",
    "trustworthiness",
]
