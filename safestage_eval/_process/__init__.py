"""Process resources: memory limits, spawned children, compiled kernels."""
