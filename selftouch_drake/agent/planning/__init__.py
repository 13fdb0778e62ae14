"""Plans on bodies with several parts and hands, on top of `quotient.route` and what follows it.

`planner` calls, for each leg, `members` and `quotient.route`; then `legs`, which chooses waypoints
by `quotient.waypoints` and bends them by `touch_model`; then `quotient.plan.path_through`.
`prediction` says what a plan will feel like, `timing` makes a motion of it.
"""
