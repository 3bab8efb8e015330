"""Compiled code that several estimators share: random draws, the modes of a network, quantiles of mixtures.

It knows no estimator, only arrays.
"""
