"""Recovers a body of several parts, as in `quotient.body`, by metrics that learn and correct."""
