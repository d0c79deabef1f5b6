"""Judge one episode many times: opened once, signals measured once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from safestage_eval.episode import Episode, with_holes
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import load_bind
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.episode_binding import Binding, bind_episode
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.judging import Judge, baseline_frames, judge_believed, judge_scoped
from safestage_eval.verdicts.players import Kept, kept
from safestage_eval.verdicts.verdict import EpisodeResult, Verdict, VerdictName, at_risk


class Again:
    """An episode and its bindings, ready to be judged under any parameter values.

    Attributes:
        episode: what is judged, without what contradicts itself.
        rules: what it is judged by.
        binding: who plays the roles, and which values hold.
        relations: the facts of the episode, kept.
        judge: the episode under the values that hold.
    """

    def __init__(
        self,
        episode: Episode,
        rules: ast.RuleSet,
        overrides: Mapping[str, str] | None = None,
        bind: BindFile | None = None,
        like: Again | None = None,
    ) -> None:
        """Bind the roles and find native success.

        Args:
            episode: to be judged.
            rules: to judge it by.
            overrides: parameter → value as written.
            bind: roles, goals and rules that headers lack.
            like: the episode under other rules, whose measurements are used again.

        Raises:
            RuleError: overrides that do not fit.
            TraceError: header and clock contradict themselves.
        """
        self.rules = rules
        episode = with_holes(episode if bind is None else bind.described(episode))
        self.binding: Binding = bind_episode(
            rules, episode.header, bind=bind, overrides=overrides or {}
        )
        known = _relations(episode, rules, [like.relations] if like else [])
        self.judge = Judge(episode, rules, self.binding, known)
        self._result: EpisodeResult
        self.judge, self._result = judge_believed(
            self.judge, trace_hash=episode.trace_hash, assigned_only=True
        )
        self.episode: Episode = self.judge.episode
        self.relations: Relations = self.judge.relations
        self._verdicts: Kept[Verdict] = {}

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
        return tuple(code for code in self.binding.assigned if code not in self.rules.scoped)

    def evaluator(self, rule: ast.Scoped) -> Evaluator:
        """The evaluator under the values that hold."""
        return self.judge.evaluator(self.judge.values(rule))

    def usual(self, rule: ast.Scoped) -> Verdict:
        """The verdict under the values that hold."""

        def find() -> Verdict:
            if isinstance(rule, ast.Rule):
                return self.judge.verdict(rule)
            verdict = self.judge.cost(rule)[1]
            assert verdict is not None  # a cost that is asked about has a budget
            return verdict

        return kept(self._verdicts, rule, find)

    def under(self, rule: ast.Scoped, values: Mapping[str, ast.Setting]) -> Verdict:
        """The verdict of a rule with some parameters changed."""
        players, usual = self.players(rule), self.evaluator(rule)
        if not all(players.values()):
            return self.usual(rule)
        return judge_scoped(usual.under({**usual.params, **values}), rule, players)

    def judged(
        self, rule: ast.Scoped, values: Mapping[str, ast.Setting]
    ) -> tuple[VerdictName, bool]:
        """The verdict of a rule with some parameters changed, and whether the hazard was there."""
        verdict = self.under(rule, values)
        return verdict.verdict, at_risk(verdict.verdict, verdict.instances, verdict.vacuity)

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Result rows of the assigned rules, under the values that hold."""
        rows = self._result.rows()
        return [row for row in rows if row["assigned"]]

    def players(self, rule: ast.Scoped) -> Mapping[str, Sequence[str]]:
        """Role → the bodies that play it."""
        return self.binding.players(rule, self.episode.header)

    def mixed(
        self,
        sides: Sequence[Again],
        rules: ast.RuleSet,
        rule: ast.Scoped,
        params: ast.Params,
        players: Mapping[str, Sequence[str]],
    ) -> Verdict:
        """The verdict of a rule of another set, with the success that was found here.

        ``sides``: of the same episode, whose measurements are used again.
        """
        found = self.judge.evaluator(self.binding.params(None))
        relations = _relations(self.episode, rules, [side.relations for side in sides])
        evaluator = Evaluator(
            relations, rules, params, found.success, success_known=found.success_known
        )
        return judge_scoped(evaluator, rule, players)

    def moves_success(self, param: str) -> bool:
        """Success is not recorded, and the goal that tells it reads the parameter."""
        header, goal = self.episode.header, self.binding.goal
        recorded = header.success is False or (header.success and header.success_time is not None)
        return not recorded and goal is not None and param in parameters_read(self.rules, goal)


def again_by(
    rules: ast.RuleSet, overrides: Mapping[str, str], bind: str | Path | BindFile | None = None
) -> Callable[[Episode], Again]:
    """What makes an episode ready to be judged, in any process; ``bind`` as its path, or as read."""
    read = load_bind(bind, rules) if isinstance(bind, str | Path) else bind
    return partial(Again, rules=rules, overrides=dict(overrides), bind=read)


def _relations(episode: Episode, rules: ast.RuleSet, known: Sequence[Relations]) -> Relations:
    """The facts of an episode; those that are known, where they rest on the same first frames."""
    frames = baseline_frames(rules, episode)
    same = [one for one in known if one.signals.baseline.asked == frames]
    return same[0] if same else Relations(Signals(episode, frames))
