"""Signals: ``(T,)`` series with a unit, measured from an episode. No thresholds."""
