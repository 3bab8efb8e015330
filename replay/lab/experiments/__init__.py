"""The paper's experiments, and the recordings that forecasts and networks are compared on."""
