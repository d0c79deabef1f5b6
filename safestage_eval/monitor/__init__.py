"""Rules watched while a rollout is still going on."""

from safestage_eval.verdicts.look_ahead import Foresight

from .monitor import Monitor, Recording, foresight

__all__ = ["Foresight", "Monitor", "Recording", "foresight"]
