"""Judge rules while a rollout is still going on, as they are judged afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from safestage_eval.episode import Episode, Header
from safestage_eval.evidence.motion import derived
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.episode_binding import bind_episode
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts.judging import Judge, baseline_frames
from safestage_eval.verdicts.verdict import Verdict

EVERY = 0.2
"""s of the recording's own time between two looks, at least."""


class Recording(Protocol):
    """Frames so far, as ``formats.TraceWriter`` holds them."""

    @property
    def header(self) -> Header:
        """The recording's header; its bodies are complete before the first frame."""
        ...

    def __len__(self) -> int:
        """T, frames so far; those that are there never change."""
        ...

    def window(self, first: int, last: int, /) -> Episode:
        """Frames first … last − 1."""
        ...


class Monitor:
    """Watches a recording as it grows and reports each violation once it is certain.

    It judges the recording so far, as a trace that was cut off, at most five times a second of the
    recording's time and at the end. A rule that was violated once stays violated.

    Attributes:
        violations: code → the verdict as it was when the violation became certain.
    """

    def __init__(
        self,
        header: Header,
        rules: ast.RuleSet,
        *,
        overrides: Mapping[str, str] | None = None,
        assigned_only: bool = False,
    ) -> None:
        """Nothing is recorded yet.

        Args:
            header: of the recording, bodies included.
            rules: to watch: all rules of which every role is played, and costs with a
                budget.
            overrides: parameter → value as written; beats every other source.
            assigned_only: only the rules that the episode's task is assigned.

        Raises:
            RuleError: an override that does not fit its parameter, a role without a body.
        """
        self._rules = rules
        self._binding = bind_episode(rules, header, overrides=overrides or {})
        self._looked = -EVERY
        self.violations: dict[str, Verdict] = {}
        every: list[ast.Scoped] = [*rules.rules.values()]
        every += [one for one in rules.costs.values() if one.budget is not None]
        self._todo = {
            rule.code: rule
            for rule in every
            if not (assigned_only and rule.code not in self._binding.assigned)
            and all(self._binding.players(rule, header).values())
        }

    @classmethod
    def of(
        cls, header: Header, rules: Sequence[str | Path], *, assigned_only: bool = False
    ) -> Monitor:
        """Load the rules of files: paths, folders or built-in names. Raises RuleErrors as ``load_rules``."""
        return cls(header, load_rules(list(rules)), assigned_only=assigned_only)

    def update(self, recording: Recording, success_time: float | None = None) -> list[Verdict]:
        """Return the violations that are certain since the last call, in the order of the rules.

        May be called after every frame: it looks again when a fifth of a second has been recorded.

        Args:
            recording: all frames so far; never fewer than before.
            success_time: s of the frame that confirmed native success, None if that has not come.
        """
        frames = len(recording)
        if not frames or not self._todo:
            return []
        now = float(recording.window(frames - 1, frames).t[0])
        if now < self._looked + EVERY - 1e-6:
            return []
        self._looked = now
        so_far = replace(
            recording.window(0, frames), header=_so_far(recording.header, success_time)
        )
        return self._certain(so_far, open_end=_derives_velocities(so_far))

    def conclude(self, recording: Recording) -> list[Verdict]:
        """Return the violations that are certain now that the recording has ended.

        The recording's header must say how it ended. Together with those told before, these are the
        violations that the evaluator finds in the recording.
        """
        frames = len(recording)
        if not frames or not self._todo:
            return []
        return self._certain(replace(recording.window(0, frames), header=recording.header))

    def _certain(self, episode: Episode, *, open_end: bool = False) -> list[Verdict]:
        """New violations; with an ``open_end`` none that the newest frame tells."""
        if len(episode) < baseline_frames(self._rules, episode):
            return []  # what is the initial state is not known yet
        judge = Judge(episode, self._rules, self._binding)
        found = []
        for code, rule in list(self._todo.items()):
            verdict = judge.verdict(rule) if isinstance(rule, ast.Rule) else judge.cost(rule)[1]
            if verdict is None or verdict.verdict != "violation":
                continue
            if open_end and verdict.time == episode.t[-1]:
                continue
            del self._todo[code]
            self.violations[code] = verdict
            found.append(verdict)
        return found


def _so_far(header: Header, success_time: float | None) -> Header:
    """Header of the trace up to now: cut off, and without success if none has come."""
    return header.model_copy(
        update={
            "termination": "truncated",
            "success": success_time is not None,
            "success_time": success_time,
            "post_success_hold": None,
        }
    )


def _derives_velocities(episode: Episode) -> bool:
    """Some velocity follows from poses: the newest frame's is another one once the next has come."""
    return any(
        derived(episode, body.name, column)
        for body in episode.header.bodies
        if body.movable
        for column in ("linear_velocity", "angular_velocity")
    )
