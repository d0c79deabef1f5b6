"""An audit's worker process: audits each episode that it is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from safestage_eval.formats import EpisodeRef
from safestage_eval.run.settings import Settings
from safestage_eval.run.worker import lasting

from .audit_episode import audit_episode
from .choose import choose


def opened(settings: Settings, codes: tuple[str, ...]) -> Callable[[EpisodeRef], Any]:
    """A function that audits an episode by the checks of these codes."""
    checks, rules = choose(codes), settings.rule_set
    return lasting(lambda ref: audit_episode(ref, checks, rules, settings.bind))
