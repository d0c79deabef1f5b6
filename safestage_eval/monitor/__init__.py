"""Rules watched while a rollout is still going on."""

from .monitor import Monitor, Recording

__all__ = ["Monitor", "Recording"]
