"""Recovers the body from the quotient graph: shape, holes and dimension (paper, section IV)."""
