"""What a controller asks: models, trust, and forecasts of many zones under many plans."""
