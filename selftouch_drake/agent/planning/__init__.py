"""From the quotient graph to a smooth geometric path in motor space (paper, section III).

A query goes through the modules in this order: `route`, `waypoints`, `smoothing`, all called by
`planner`; then `prediction`.
"""

from selftouch_drake.agent.planning.planner import (
    Limits,
    Planner,
    checked_configuration,
    checked_target,
)
from selftouch_drake.agent.planning.prediction import (
    Prediction,
    predict_sensation,
    recall_sensation,
)
from selftouch_drake.agent.planning.route import firm_members, goal_members
from selftouch_drake.agent.planning.smoothing import (
    KNOT_SPACING,
    polyline,
    smooth_path,
)

__all__ = [
    "KNOT_SPACING",
    "Limits",
    "Planner",
    "Prediction",
    "checked_configuration",
    "checked_target",
    "firm_members",
    "goal_members",
    "polyline",
    "predict_sensation",
    "recall_sensation",
    "smooth_path",
]
