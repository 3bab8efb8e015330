"""Buildings simulated by EnergyPlus: a plant whose equations are not this project's. Needs the extra `energyplus`."""
