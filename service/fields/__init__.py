"""Re-exports of adapters.fields, until every room imports from there."""
