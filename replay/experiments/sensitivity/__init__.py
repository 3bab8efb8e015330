"""`sensitivity`: what the settings of the particle filter do (5.1.5)."""
