"""A building of EnergyPlus behind the servers of the simulated BMS. Needs the extra `energyplus`."""
