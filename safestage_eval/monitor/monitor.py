"""Judge rules while a rollout is still going on, as they are judged afterwards."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Protocol

from safestage_eval.episode import Episode, Header, with_holes
from safestage_eval.evidence.growing_store import GrowingStore
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.episode_binding import bind_episode
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.judging import Judge, baseline_frames
from safestage_eval.verdicts.look_ahead import Foresight, Look, latest
from safestage_eval.verdicts.obligations import OBLIGATIONS, cost
from safestage_eval.verdicts.rule_verdict import violates
from safestage_eval.verdicts.success import frame_of
from safestage_eval.verdicts.verdict import Verdict


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


def foresight(
    rules: ast.RuleSet,
    rule: ast.Scoped,
    params: ast.Params,
    frame_dt: float,
    *,
    blind: bool = False,
) -> Foresight:
    """How far a rule or cost looks ahead; arguments as in ``Look``."""
    look = Look(rules, params, frame_dt, blind=blind)
    if isinstance(rule, ast.Cost):
        return latest([look.scope(rule), cost.foresight(look, rule)])
    clauses = [OBLIGATIONS[c.kind].foresight(look, rule, c.what) for c in rule.clauses]
    return latest([look.scope(rule), *clauses])


class Monitor:
    """Watches a recording as it grows and reports each violation once it is certain.

    At any time a rule counts as violated exactly if the evaluator says so of the trace up to now,
    as one that was cut off: whatever comes later, it stays violated. So a rule that looks only at
    the past is reported as soon as its states are known (``watched`` says how much later that may be),
    and one that needs the future is reported when its window has been recorded (``awaited``).

    Attributes:
        watched: code → how far ahead each causal rule looks.
        awaited: code → what each of the other rules waits for.
        violations: code → the verdict as it was when the violation became certain.
    """

    def __init__(
        self,
        header: Header,
        rules: ast.RuleSet,
        *,
        overrides: Mapping[str, str] | None = None,
        backend: str = "gjk",
        assigned_only: bool = False,
    ) -> None:
        """Nothing is recorded yet.

        Args:
            header: of the recording, bodies included.
            rules: to watch: all rules of which every role is played, and costs with a
                budget.
            overrides: parameter → value as written; beats every other source.
            backend: that measures clearances.
            assigned_only: only the rules that the episode's task is assigned.

        Raises:
            RuleError: an override that does not fit its parameter, a role without a body.
        """
        self._rules, self._backend = rules, backend
        self._binding = bind_episode(rules, header, overrides=overrides or {})
        self._store = GrowingStore()
        self._todo: dict[str, tuple[ast.Scoped, ast.Params, Mapping[str, Sequence[str]]]] = {}
        self.violations: dict[str, Verdict] = {}
        self.watched: dict[str, Foresight] = {}
        self.awaited: dict[str, Foresight] = {}
        every: list[ast.Scoped] = [*rules.rules.values()]
        every += [one for one in rules.costs.values() if one.budget is not None]
        for rule in every:
            code = rule.code
            players = self._binding.players(rule, header)
            if (assigned_only and code not in self._binding.assigned) or not all(players.values()):
                continue
            params = self._binding.params(rule)
            ahead = foresight(
                rules, rule, params, header.frame_dt, blind=header.force_source == "none"
            )
            self._todo[code] = rule, params, players
            (self.watched if ahead.causal else self.awaited)[code] = ahead

    @classmethod
    def of(
        cls, header: Header, rules: Sequence[str | Path], *, assigned_only: bool = False
    ) -> Monitor:
        """Load the rules of files: paths, folders or built-in names. Raises RuleErrors as ``load_rules``."""
        return cls(header, load_rules(list(rules)), assigned_only=assigned_only)

    def update(self, recording: Recording, success_time: float | None = None) -> list[Verdict]:
        """Return violations that have become certain since the last call, in the order of the rules.

        Args:
            recording: all frames so far; never fewer than before.
            success_time: s of the frame that confirmed native success, None if that has not come.
        """
        return self._judged(recording, _so_far(recording.header, success_time))

    def conclude(self, recording: Recording) -> list[Verdict]:
        """Return violations that are certain now that the recording has ended.

        The recording's header must say how it ended. Together with those told before, these are the
        violations that the evaluator finds in the recording.
        """
        return self._judged(recording, recording.header)

    def _judged(self, recording: Recording, header: Header) -> list[Verdict]:
        frames = len(recording)
        if not frames or not self._todo:
            return []
        episode = replace(recording.window(0, frames), header=header)
        first = baseline_frames(self._rules, episode)
        if frames < first:  # what is the initial state is not known yet
            return []
        seen = with_holes(episode)
        if seen is episode:
            self._store.grow(frames, _windows(recording, first, self._backend))
            signals = Signals(episode, first, self._backend, self._store)
            signals.gaps.whole = False
            relations = Relations(signals)
        else:  # frames are put in, and do not grow by those at the end alone
            episode, relations = seen, Relations(Signals(seen, first, self._backend))
        evaluators: list[Evaluator] = []
        judge: Judge | None = None
        certain = []
        for code, (rule, params, players) in list(self._todo.items()):
            evaluator = self._evaluator(evaluators, relations, params, episode)
            if not _violated(evaluator, rule, players):
                continue
            judge = judge or Judge(
                episode, self._rules, self._binding, relations, backend=self._backend
            )
            verdict = judge.verdict(rule) if isinstance(rule, ast.Rule) else judge.cost(rule)[1]
            if verdict is not None and verdict.verdict == "violation":
                del self._todo[code]
                self.violations[code] = verdict
                certain.append(verdict)
        return certain

    def _evaluator(
        self,
        evaluators: list[Evaluator],
        relations: Relations,
        params: ast.Params,
        episode: Episode,
    ) -> Evaluator:
        """Share one evaluator among all rules with the same values."""
        for evaluator in evaluators:
            if evaluator.params == params:
                return evaluator
        header = episode.header
        frame = None
        if header.success and header.success_time is not None:
            frame = frame_of(episode, header.success_time)
        evaluators.append(Evaluator(relations, self._rules, params, frame))
        return evaluators[-1]


def _windows(
    recording: Recording, baseline_frames: int, backend: str
) -> Callable[[int, int], Relations]:
    """A function that gives the relations, and signals, of frames first … last − 1.

    It keeps them: each stretch is measured once. Frames count from the stretch's first.
    """

    @cache
    def relations(first: int, last: int) -> Relations:
        signals = Signals(recording.window(first, last), baseline_frames, backend)
        signals.gaps.whole = False
        return Relations(signals)

    return relations


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


def _violated(evaluator: Evaluator, rule: ast.Scoped, players: Mapping[str, Sequence[str]]) -> bool:
    if isinstance(rule, ast.Rule):
        return violates(evaluator, rule, players)
    blank = Verdict(rule.code, rule.title, rule.stage, assigned=False, verdict="not_applicable")
    verdict = cost.judge_cost(evaluator, rule, players, blank)[1]
    return verdict is not None and verdict.verdict == "violation"
