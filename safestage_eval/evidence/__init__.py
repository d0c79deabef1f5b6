"""Measurements of an episode: facts, series, and the stores that answer queries about them."""
