"""What every report is made of: sections, tables, plots and verdicts, as one page and as files."""
