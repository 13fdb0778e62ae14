"""Learns the quotient representation, as in `quotient.learn`, of bodies with parts and hands.

Its scikit-learn estimator is in `representation.estimator`, and not needed to use it.
"""
