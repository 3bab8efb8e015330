"""Linear models that an estimator's state stands for: their matrices at any step, and their simulation."""
