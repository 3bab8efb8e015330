"""Re-exports of adapters, until every room imports from there."""
