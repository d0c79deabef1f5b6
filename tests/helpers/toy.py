"""Rules over given series: the language without physics."""

from __future__ import annotations

import functools
import tomllib
from types import SimpleNamespace
from typing import Any

import numpy as np
from scenes import Scene

from safestage_eval.episode import Episode
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.reference import Baseline
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.signals import SIGNALS
from safestage_eval.verdicts.cost import judge_cost
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.rule_verdict import judge_rule
from safestage_eval.verdicts.verdict import CostTotal, Verdict

HEAD = """
[ruleset]
format = 1
name = "toy"
version = "1"
[state.p]
of = ["a"]
when = { "height(a)" = ">= 0 m" }
[state.q]
of = ["b"]
when = { "height(b)" = ">= 0 m" }
[[rule]]
code = "TOY101"
title = "toy"
roles = { a = "object", b = "object" }
"""
ALONE = HEAD.replace(', b = "object"', "")
"""For rules about one body."""


class Facts:
    """Stands for ``Relations``: series given by name and bodies, nothing measured."""

    unweighed: tuple[str, ...] = ()

    def __init__(
        self,
        series: dict[str, Any],
        *,
        rate: float = 1.0,
        truncated: bool = False,
        coarse: bool = False,
        **header: Any,
    ):
        """``coarse``: something may happen between two samples that are far apart."""
        frames = len(next(iter(series.values())))
        termination = "truncated" if truncated else "horizon"
        self.episode = _empty(frames, rate, coarse, termination=termination, **header)
        first = Baseline(5)
        self.signals = SimpleNamespace(baseline=first, baseline_of=lambda _: first)
        self._series = {name: np.asarray(values, float) for name, values in series.items()}

    def between_frames(self, *_: Any) -> None:
        """Nothing moves between frames."""

    def signal(self, name: str, bodies: tuple[str, ...], *_: Any) -> Interval:
        values = self._series[f"{name}({', '.join(bodies)})"]
        unknown = np.isnan(values)
        return Interval(
            np.where(unknown, -np.inf, values),
            np.where(unknown, np.inf, values),
            SIGNALS[name].dimension,
        )

    def told(self, name: str, bodies: tuple[str, ...], *_: Any) -> Interval:
        truth = (self._series[f"{name}({', '.join(bodies)})"] > 0).astype(float)
        return Interval(truth, truth, "number")


@functools.cache
def _empty(frames: int, rate: float, coarse: bool, **header: Any) -> Episode:
    episode = Scene(frames, rate).episode(**header)
    if not coarse:
        vars(episode.clock)["coarse"] = np.zeros(frames, np.bool_)
    return episode


@functools.cache
def ruleset(text: str) -> ast.RuleSet:
    """A rule set of one file's text."""
    return merge([RuleFile("toy.toml", text, tomllib.loads(text), asked=True)])


def cost_toy(
    facts: Facts, text: str, players: dict[str, tuple[str, ...]] | None = None, **params: Any
) -> tuple[CostTotal, Verdict | None]:
    """Value of the last cost of ``text`` (appended to HEAD)."""
    rules = ruleset(HEAD + 'require = { "p(a)" = true, "q(b)" = true }\n' + text)
    cost = list(rules.costs.values())[-1]
    evaluator = Evaluator(facts, rules, {**rules.params, **params}, None)  # type: ignore[arg-type]
    blank = Verdict(cost.code, cost.title, cost.stage, True, "not_applicable")
    players = players or {name: (name,) for name, _ in cost.roles}
    return judge_cost(evaluator, cost, players, blank)


def judge_toy(
    facts: Facts,
    text: str,
    players: dict[str, tuple[str, ...]] | None = None,
    success: int | None = None,
    **params: Any,
) -> Verdict:
    """The verdict of the last rule of ``text`` (appended to HEAD unless it has a ruleset)."""
    rules = ruleset(text if "[ruleset]" in text else HEAD + text)
    rule = list(rules.rules.values())[-1]
    evaluator = Evaluator(facts, rules, {**rules.params, **params}, success)  # type: ignore[arg-type]
    blank = Verdict(rule.code, rule.title, rule.stage, True, "not_applicable")
    players = players or {name: (name,) for name, _ in rule.roles}
    return judge_rule(evaluator, rule, players, blank)


def series(truth: str) -> np.ndarray:
    """``"01?"`` → heights below 0, at or above 0, unknown."""
    return np.array([{"0": -1.0, "1": 1.0, "?": np.nan}[c] for c in truth])
