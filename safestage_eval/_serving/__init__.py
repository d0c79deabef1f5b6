"""Guards for every server: allowed origins and hosts, size limits, isolation of each message."""
