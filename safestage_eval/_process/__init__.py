"""What a process holds and starts: memory limits, spawned children, compiled kernels."""
