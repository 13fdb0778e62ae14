"""Distances along a skin, by which the experimenter judges the agent's."""

from selftouch_drake.geometry.geodesics import surface_distances

__all__ = ["surface_distances"]
