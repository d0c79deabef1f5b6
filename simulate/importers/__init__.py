"""Recordings of other MuJoCo simulators: stored states are loaded again, contacts recomputed."""
