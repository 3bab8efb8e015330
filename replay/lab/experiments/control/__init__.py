"""`control`: the loop closed over buildings of EnergyPlus, by a thermostat, by planners and by perfect knowledge."""
