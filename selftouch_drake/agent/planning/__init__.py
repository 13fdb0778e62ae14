"""From the quotient graph to a smooth geometric path in motor space (paper, section III).

A query goes through the modules in this order: `route`, `waypoints`, `touch_model`, `smoothing`,
all called by `planner`; then `prediction`.
"""
