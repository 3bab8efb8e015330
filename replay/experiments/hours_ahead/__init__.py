"""`hours-ahead`: forecasts of the next step and of the next day, by every estimator, on recordings of many kinds."""
