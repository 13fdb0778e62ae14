"""Scores of the agent against the truth; the only package that reads both sides."""
