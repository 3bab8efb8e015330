"""What a bench measures, one module a section; each runs in a process of its own."""
