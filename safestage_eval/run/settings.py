"""How every episode of a run is judged, and what it may take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from safestage_eval.rules import BindFile, RuleSet, load_rules

from .score_episode import Look


@dataclass(frozen=True)
class Settings:
    """Settings of a worker; can be pickled.

    Attributes:
        rules: paths, folders or built-in names of rule files.
        overrides: parameter → value as written.
        bind: what a bind file, read already, and the command line bind.
        assigned_only: judge each episode by its own assigned rules alone.
        strict: refuse episodes whose columns contradict each other.
        timeout: s that an episode may take; None: any.
        memory: bytes that the process which judges it may hold; None: any.
        look: what else is to be found in every episode, once it is judged; can be pickled.
    """

    rules: tuple[str | Path, ...]
    overrides: Mapping[str, str] | None = None
    bind: BindFile | None = None
    assigned_only: bool = False
    strict: bool = False
    timeout: float | None = None
    memory: int | None = None
    look: Look | None = None

    @cached_property
    def rule_set(self) -> RuleSet:
        """The rules themselves: read once, and sent to every worker with the settings.

        Raises RuleErrors, RuleError: they do not mean anything.
        """
        return load_rules(list(self.rules))

    def copy_with(self, **changes: Any) -> Settings:
        """A copy with other values; rules that were loaded stay, if they are the same."""
        changed = replace(self, **changes)
        if changed.rules == self.rules and "rule_set" in self.__dict__:
            changed.__dict__["rule_set"] = self.rule_set
        return changed

    def arguments(self) -> dict[str, Any]:
        """Those of ``score_episode`` besides the episode and the rules."""
        return {
            "overrides": self.overrides,
            "bind": self.bind,
            "assigned_only": self.assigned_only,
            "strict": self.strict,
            "look": self.look,
        }


def load_settings(
    rules: Sequence[str | Path],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    assign: Sequence[str] = (),
    roles: Sequence[str] = (),
    protect: Sequence[str] = (),
    assigned_only: bool = False,
    strict: bool = False,
    timeout: float | None = None,
    memory: int | None = None,
) -> Settings:
    """Check the settings of a run and load its rules.

    Args:
        rules: paths, folders or built-in names of rule files.
        overrides: parameter → value as written; beats every other source.
        bind: a bind file: roles, goal, rules and values that the traces' headers lack.
        assign: codes of rules for every episode; as ``rules.command_binding`` reads them, these and
            the next two beat every other source.
        roles: ``ROLE=BODIES``.
        protect: bodies of the role ``protected``.
        assigned_only: judge each episode by its own assigned rules alone.
        strict: refuse episodes whose columns contradict each other, instead of leaving these unknown.
        timeout: s that an episode may take; one that takes longer is a problem.
        memory: bytes that the process which judges an episode may hold; one that holds more is a problem. Either needs a
            worker process, so there is one at least.

    Raises:
        RuleErrors, RuleError: rules, overrides or a bind file that do not mean anything.
    """
    from safestage_eval.rules import load_binding, parse_overrides

    settings = Settings(
        tuple(rules), overrides, None, assigned_only, strict, timeout=timeout, memory=memory
    )
    loaded = settings.rule_set
    parse_overrides(loaded, overrides or {})
    return settings.copy_with(bind=load_binding(bind, loaded, assign, roles, protect))
