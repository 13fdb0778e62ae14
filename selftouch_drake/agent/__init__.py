"""The naive agent: it learns from experience, recovers its body and plans.

`Agent` is what it knows, `Body` is the door to its world, and a `Pilot` moves the one through the
other. Who makes a plan, who follows it and who scores it is in `docs/code.md`.
"""
