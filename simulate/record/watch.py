"""Rules watched during a rollout: violations are reported at once, and may stop it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from safestage_eval.formats import TraceWriter
from safestage_eval.monitor import Monitor
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.rules import syntax as ast

if TYPE_CHECKING:
    from safestage_eval.verdicts import Verdict

EVERY = 4
"""Control steps between two looks: about a quarter of a second."""


@dataclass(frozen=True)
class Watching:
    """The watched rules, and what a violation does.

    Attributes:
        rules: paths, folders or built-in names of rule files, all rules of which are watched; none
            for the rules that the task is assigned.
        stop: the rollout ends at the first violation.
    """

    rules: tuple[str, ...] = ()
    stop: bool = False

    def of(self, writer: TraceWriter) -> Watch:
        """A watch on one recording, whose bodies are declared."""
        return Watch(writer, self)


class Watch:
    """Looks at a recording every now and then, and tells each violation on stderr."""

    def __init__(self, writer: TraceWriter, watching: Watching) -> None:
        """Nothing has happened yet."""
        self._writer, self._stop = writer, watching.stop
        self._monitor = Monitor(
            writer.header, _loaded(watching.rules), assigned_only=not watching.rules
        )
        self._steps = 0

    def look(self, success_time: float | None) -> bool:
        """After each control step; true if the rollout is to end here."""
        self._steps += 1
        if self._steps % EVERY:
            return False
        self._tell(self._monitor.update(self._writer, success_time))
        return self._stop and bool(self._monitor.violations)

    def conclude(self) -> None:
        """The rollout is over, and the header says how: judge what had to wait for that."""
        self._tell(self._monitor.conclude(self._writer))

    @property
    def seen(self) -> list[str]:
        """``ETS201 at 4.22 s``, for each violation, the earliest first."""
        verdicts = self._monitor.violations.values()
        return [_when(verdict) for verdict in sorted(verdicts, key=lambda v: v.time or 0.0)]

    def _tell(self, verdicts: Sequence[Verdict]) -> None:
        for verdict in verdicts:
            name = self._writer.header.episode_id
            sys.stderr.write(f"{name}: {_when(verdict)}: {verdict.explanation}\n")
        sys.stderr.flush()


def _when(verdict: Verdict) -> str:
    return verdict.rule + ("" if verdict.time is None else f" at {verdict.time:.2f} s")


@cache
def _loaded(rules: tuple[str, ...]) -> ast.RuleSet:
    return load_rules(rules or builtin_names())
