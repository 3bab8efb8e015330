"""The building that the plant simulates itself: its rooms, the weather and people's habits, its thermostats."""
