"""Shapes, distances, footprints, edges and cavities: pure functions of shapes and poses.

Nothing here knows thresholds, rules or roles. Import from the modules; this file imports nothing,
so that asking for a rotation loads no geometry library.
"""
