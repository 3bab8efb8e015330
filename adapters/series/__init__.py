"""Histories in databases of time series: Prometheus, InfluxDB and what answers as they do."""
