"""What an estimator does not know, as named findings with a remedy. The zone's worker and the replay may come in."""
