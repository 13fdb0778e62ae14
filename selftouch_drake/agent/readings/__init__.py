"""Raw readings of a real skin: what they are at rest (`baseline`), and where they are touches.

Not `selftouch_drake.calibration`, which places a skin on a model of a robot, in metres.
"""
