"""OPC UA servers, read only: current values and history. What needs asyncua is imported when it runs."""
