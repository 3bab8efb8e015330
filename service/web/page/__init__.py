"""The page for people: its files, and what it asks beyond the zones' own routes: all zones at a glance, and charts."""
