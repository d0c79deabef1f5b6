"""Everyday objects: a row per object in the TOML files, built from primitives by ``objects``."""
