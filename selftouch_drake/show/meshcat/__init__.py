"""Recordings and live play in Meshcat."""
