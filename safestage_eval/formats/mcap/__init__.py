"""MCAP files: messages, reading and writing (docs/traces.md)."""
