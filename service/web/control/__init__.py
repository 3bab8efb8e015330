"""What a controller asks: models, trust, forecasts of many zones under many plans, and when to heat."""
