"""`cost`: time and memory of one sample (Table 9)."""
