"""What a zone makes of its inputs to come where no plan says."""
