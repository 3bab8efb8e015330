"""One series and one estimator or fit over it: what every experiment runs."""
