"""What messages carry, whoever brings them: JSON pointers, SenML, times, numbers with quality."""
