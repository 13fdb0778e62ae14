"""From the quotient graph to a smooth geometric path in motor space (paper, section III)."""

from selftouch_drake.agent.planning.plan import (
    NO_KERNEL,
    Plan,
    Planner,
    RouteMethod,
    jerk_reduction,
)
from selftouch_drake.agent.planning.prediction import Prediction, predict_sensation
from selftouch_drake.agent.planning.route import near_links
from selftouch_drake.agent.planning.smoothing import polyline, smooth_path

__all__ = [
    "NO_KERNEL",
    "Plan",
    "Planner",
    "Prediction",
    "RouteMethod",
    "jerk_reduction",
    "near_links",
    "polyline",
    "predict_sensation",
    "smooth_path",
]
