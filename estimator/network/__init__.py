"""RC networks as data, their matrices and their exact discretisation. Every estimator may come in."""
