"""Judge one episode many times: opened once, signals measured once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from safestage_eval.episode import Episode, as_judged
from safestage_eval.evidence.measure import CAP, Signals
from safestage_eval.evidence.reference import Reference
from safestage_eval.evidence.series import Series
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.episode_binding import Binding, bind_episode
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.judging import Judge, baseline_frames
from safestage_eval.verdicts.severity_levels import judge_scoped
from safestage_eval.verdicts.verdict import Verdict


class Measured(Relations):
    """Relations that measure a distance at once as far as any later question may reach."""

    def __init__(self, signals: Signals, furthest: float) -> None:
        """``furthest``: m; questions beyond the usual 10 cm are answered up to there."""
        super().__init__(signals)
        self._furthest = furthest

    def signal(
        self,
        name: str,
        bodies: Sequence[str],
        reference: Reference | None = None,
        reach: float = 0,
        *more: Any,
        **others: Any,
    ) -> Series:
        """Measure a signal, distances as far as ``furthest``."""
        far = max(reach, self._furthest) if reach > CAP else reach
        return super().signal(name, bodies, reference, far, *more, **others)


class Again:
    """An episode and its bindings, ready to be judged under any parameter values."""

    def __init__(
        self,
        episode: Episode,
        rules: ast.RuleSet,
        overrides: Mapping[str, str] | None = None,
        bind: BindFile | None = None,
        furthest: float = 0.0,
        like: Again | None = None,
    ) -> None:
        """Bind the roles and find native success.

        Args:
            episode: to be judged.
            rules: to judge it by.
            overrides: parameter → value as written.
            bind: roles, goals and rules that headers lack.
            furthest: m, the greatest distance that will be compared with a limit.
            like: the episode under other rules, whose measurements are used again.

        Raises RuleError for overrides that do not fit.
        """
        episode = episode if bind is None else bind.described(episode)
        self.episode, self.rules = as_judged(episode), rules
        episode = self.episode
        self.binding: Binding = bind_episode(
            rules, episode.header, bind=bind, overrides=overrides or {}
        )
        frames = baseline_frames(rules, episode)
        shared: Relations | None = like.relations if like is not None else None
        if shared is None or shared.signals.baseline.asked != frames:
            shared = Measured(Signals(episode, frames), furthest)
        self.relations: Relations = shared
        self.judge = Judge(episode, rules, self.binding, self.relations)

    @property
    def assigned(self) -> list[ast.Scoped]:
        """The loaded rules, and costs with a budget, that are assigned to the task."""
        loaded: dict[str, ast.Scoped] = {
            **self.rules.rules,
            **{code: cost for code, cost in self.rules.costs.items() if cost.budget is not None},
        }
        return [loaded[code] for code in self.binding.assigned if code in loaded]

    @property
    def not_loaded(self) -> tuple[str, ...]:
        """Codes of assigned rules and costs that are not loaded."""
        loaded = self.rules.rules.keys() | self.rules.costs.keys()
        return tuple(code for code in self.binding.assigned if code not in loaded)

    def base(self, rule: ast.Scoped) -> tuple[Evaluator, Verdict]:
        """The verdict under the values that hold, and the evaluator that others start from."""
        evaluator = self.judge.evaluator(self.binding.params(rule))
        if isinstance(rule, ast.Rule):
            return evaluator, self.judge.verdict(rule)
        verdict = self.judge.cost(rule)[1]
        assert verdict is not None  # it has a budget
        return evaluator, verdict

    def under(
        self, base: Evaluator, rule: ast.Scoped, values: Mapping[str, ast.Setting]
    ) -> Verdict:
        """The verdict of a rule with some parameters changed."""
        players = self.binding.players(rule, self.episode.header)
        if not all(players.values()):
            return self.base(rule)[1]
        return judge_scoped(base.under({**base.params, **values}), rule, players)
