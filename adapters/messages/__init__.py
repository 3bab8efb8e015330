"""What publishers send by themselves, whoever brings it: it waits here, is dated, and becomes readings."""
