"""From the quotient graph to a smooth geometric path in motor space (paper, section III)."""

from selftouch_drake.agent.planning.checks import Limits, checked_configuration, checked_target
from selftouch_drake.agent.planning.planner import Planner, RouteMethod
from selftouch_drake.agent.planning.prediction import (
    Prediction,
    predict_sensation,
    recall_sensation,
)
from selftouch_drake.agent.planning.route import FindNearest
from selftouch_drake.agent.planning.smoothing import (
    KNOT_SPACING,
    jerk_reduction,
    polyline,
    smooth_path,
)

__all__ = [
    "KNOT_SPACING",
    "FindNearest",
    "Limits",
    "Planner",
    "Prediction",
    "RouteMethod",
    "checked_configuration",
    "checked_target",
    "jerk_reduction",
    "polyline",
    "predict_sensation",
    "recall_sensation",
    "smooth_path",
]
