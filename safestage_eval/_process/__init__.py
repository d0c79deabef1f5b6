"""Process resources: memory limits, spawned children."""
