"""The report of a period: a table for the terminal and a page, from what the zones' workers went through."""
