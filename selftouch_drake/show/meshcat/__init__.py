"""Recordings and live play: what moves, in Meshcat."""
