"""The command line. Nothing imports it but entry points."""
