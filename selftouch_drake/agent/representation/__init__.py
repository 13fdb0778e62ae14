"""Learns the quotient representation from experience (paper, sections II, III).

Its scikit-learn estimator is in `representation.estimator`, and not needed to use it.
"""
