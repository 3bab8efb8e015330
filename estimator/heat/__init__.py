"""Heat that is known up to coefficients: which terms a network gets, and their known f at any time, past or planned."""
