"""Rules watched while a rollout is still going on."""

from safestage_eval.verdicts.look_ahead import Foresight

from .foresight import foresight
from .monitor import Monitor
from .windows import Recording

__all__ = ["Foresight", "Monitor", "Recording", "foresight"]
