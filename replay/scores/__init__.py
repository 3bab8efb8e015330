"""Scores of forecasts, of learned parameters and of what alpha says (paper 3.5, 4.3.3 and 4.3.7)."""
