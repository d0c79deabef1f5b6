"""How every episode of a run is judged, and what it may take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval.rules import BindFile, RuleSet, load_rules

if TYPE_CHECKING:
    from safestage_eval.evidence.cache_folder import CacheFolder


@dataclass(frozen=True)
class Settings:
    """What a worker needs to know; can be pickled.

    Attributes:
        rules: paths, folders or built-in names of rule files.
        overrides: parameter → value as written.
        bind: a bind file that was read already.
        backend: whose clearances.
        assigned_only: judge each episode by its own assigned rules alone.
        cache: folder in which measurements are kept.
        verdicts_only: keep verdicts there, and no measurements, which are a hundred times larger.
        timeout: s that an episode may take; None: any.
        memory: bytes that the process which judges it may hold; None: any.
    """

    rules: tuple[str | Path, ...]
    overrides: Mapping[str, str] | None = None
    bind: BindFile | None = None
    backend: str = "gjk"
    assigned_only: bool = False
    cache: str | Path | None = None
    verdicts_only: bool = False
    timeout: float | None = None
    memory: int | None = None

    def _folder(self) -> CacheFolder | None:
        if self.cache is None:
            return None
        from safestage_eval.evidence.cache_folder import CacheFolder

        return CacheFolder(self.cache, measurements=not self.verdicts_only)

    def load(self) -> RuleSet:
        """The rules themselves."""
        return load_rules(list(self.rules))

    def arguments(self) -> dict[str, Any]:
        """Those of ``scoring.score_episode`` besides the episode and the rules."""
        return {
            "overrides": self.overrides,
            "bind": self.bind,
            "backend": self.backend,
            "assigned_only": self.assigned_only,
            "cache": self._folder(),
        }
