"""What a worker process does in an audit: it audits the episodes that it is sent, one after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from safestage_eval.formats import EpisodeRef
from safestage_eval.run.settings import Settings
from safestage_eval.run.worker import lasting

from .audit_episode import audit_episode
from .choose import choose


def opened(settings: Settings, codes: tuple[str, ...]) -> Callable[[EpisodeRef], Any]:
    """What audits an episode by the checks with these codes."""
    checks, rules = choose(codes), settings.rule_set
    return lasting(lambda ref: audit_episode(ref, checks, rules, settings.bind))
