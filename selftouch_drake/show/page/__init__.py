"""Figures and the report: what fits on a page."""
