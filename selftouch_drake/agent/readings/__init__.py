"""Raw readings of a real skin: what they are at rest (`baseline`), and where they are touches.

Not `selftouch_drake.agent.given_model`, which puts a model of a robot right, in metres.
"""
