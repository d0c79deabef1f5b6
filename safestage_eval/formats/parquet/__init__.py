"""Parquet datasets: table schemas, reading and writing (docs/traces.md)."""
