"""Scores of the agent against the truth; the only package that reads both sides."""

from selftouch_drake.evaluation.coverage import coverage, touch_density
from selftouch_drake.evaluation.kernels import KernelTruth, kernel_truth
from selftouch_drake.evaluation.motion import cosine_distance, jerk_reduction, random_pairs
from selftouch_drake.evaluation.parts import TouchCounts, TruePart, true_parts
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
    "TouchCounts",
    "TruePart",
    "align",
    "cosine_distance",
    "coverage",
    "distance_distortion",
    "jerk_reduction",
    "kernel_truth",
    "neighbour_agreement",
    "parts_on_skins",
    "random_pairs",
    "shape_errors",
    "shape_rms_fraction",
    "touch_density",
    "true_parts",
    "trustworthiness",
]
