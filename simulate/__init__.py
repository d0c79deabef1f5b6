"""Record SafeStage episodes in MuJoCo with the DROID arm. Needs the ``simulate`` extra."""

SAFESTAGE = True
"""Tells this package from the other one of the same name on PyPI."""
