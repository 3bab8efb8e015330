"""What the page for people asks beyond the zones' own routes: all zones at a glance, and charts of any length."""
