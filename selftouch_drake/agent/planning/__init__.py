"""From the quotient graph to a smooth geometric path in motor space (paper, section III).

A query goes through the modules in this order: `route`, `waypoints`, `touch_model`, `smoothing`,
all called by `planner`; then `prediction`.
"""

from selftouch_drake.agent.planning.planner import Limits, Planner, checked_configuration
from selftouch_drake.agent.planning.prediction import predict_sensation
from selftouch_drake.agent.planning.smoothing import polyline, smooth_path

__all__ = [
    "Limits",
    "Planner",
    "checked_configuration",
    "polyline",
    "predict_sensation",
    "smooth_path",
]
