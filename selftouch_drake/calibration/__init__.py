"""Metres for what a naive agent found: not naive itself, since it is given a kinematic model."""
