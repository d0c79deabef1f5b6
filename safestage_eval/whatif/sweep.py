"""A threshold against the rates: every value judged, from one pass over the traces."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.metrics import METRICS, Outcome, Rates, rates
from safestage_eval.rules import RuleSet, load_bind, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import reached
from safestage_eval.rules.uses import own_params
from safestage_eval.units import DIMENSIONS
from safestage_eval.verdicts.engagement import Engagement
from safestage_eval.verdicts.problem import Problem
from safestage_eval.verdicts.verdict import Verdict, VerdictName, at_risk

from .again import Again, Value
from .flips import pieces_of
from .many import each_episode
from .swept_values import amount

FEW = 4
"""Up to so many values are judged one by one."""

GROUPS = ("policy", "prompt", "stage", "task", "rule")
"""What curves can be told apart by."""


@dataclass(frozen=True)
class Swept:
    """One episode under every value.

    Attributes:
        episode_id, path, task, policy, prompt, stage: from its header; ``–`` where it says nothing.
        success: S.
        rest: verdicts (V) of its assigned rules that do not read the parameter.
        moved: code of each assigned rule that does → its verdict for every value.
        risk: the same → whether that verdict was reached on something.
        rest_at_risk: an assigned rule that does not read the parameter was judged on something.
        engagement: how far it got with its target; None if unknown.
        unread: True if no assigned rule reads the parameter; then nothing was measured.
        missing: an assigned rule is not loaded.
    """

    episode_id: str
    path: str
    task: str
    policy: str
    prompt: str
    stage: str
    success: bool | None = None
    rest: tuple[bool | None, ...] = ()
    moved: Mapping[str, tuple[VerdictName, ...]] | None = None
    risk: Mapping[str, tuple[bool, ...]] | None = None
    rest_at_risk: bool = False
    engagement: Engagement | None = None
    unread: bool = False
    missing: bool = False

    def violation(self, index: int, rule: str | None = None) -> bool | None:
        """V under the value with this index: of one rule, or of all assigned ones."""
        codes = [rule] if rule is not None else list(self.moved or {})
        found = [_violation((self.moved or {})[code][index]) for code in codes]
        if rule is None:
            found += self.rest
            if True not in found and self.missing:
                return None
        return True if True in found else None if None in found else False

    def at_risk(self, index: int, rule: str | None = None) -> bool:
        """Whether one rule, or any assigned one, was judged on something under that value."""
        risk = self.risk or {}
        if rule is not None:
            return risk[rule][index]
        return self.rest_at_risk or any(at[index] for at in risk.values())


@dataclass(frozen=True)
class Curves(ABC):
    """The rates of episodes under every value of a parameter.

    Attributes:
        param: its name.
        values: in rising order.
        default: the value of ``[param]``.
        readers: codes of the rules that read it and judged an episode.
        unread: how many episodes have no assigned rule that reads it.
        problems: what could not be judged.
    """

    param: str
    values: tuple[Value, ...]
    default: Value
    readers: tuple[str, ...]
    unread: int
    problems: tuple[Problem, ...]

    @property
    @abstractmethod
    def count(self) -> int:
        """Of the episodes that are counted."""

    @abstractmethod
    def curves(self, by: Sequence[str] = ()) -> dict[tuple[str, ...], list[Rates]]:
        """Group → the rates under every value; one group ``()`` if nothing is told apart."""

    @property
    def remarks(self) -> list[str]:
        """Sentences on how the verdicts were found."""
        return []

    @abstractmethod
    def flips(self) -> list[dict[str, Any]]:
        """Between which two values each verdict changes."""

    def rows(self, by: Sequence[str] = ()) -> list[dict[str, Any]]:
        """One flat row per group and value: rates 0…1, their counts, what is not in N, and at risk."""
        return [
            {
                **dict(zip(by, key, strict=True)),
                "param": self.param,
                "value": amount(value),
                "unit": _si(value),
                **{metric: cell.value(metric) for metric in METRICS},
                **{f"{metric}_k": cell.counts[metric] for metric in METRICS},
                "n": cell.n,
                "inconclusive": cell.inconclusive,
                "not_judged": cell.not_judged,
                "at_risk": cell.given["at risk"]["N"],
                **{f"{metric}_at_risk": cell.value(metric, "at risk") for metric in METRICS},
            }
            for key, cells in self.curves(by).items()
            for value, cell in zip(self.values, cells, strict=True)
        ]


@dataclass(frozen=True)
class Sweep(Curves):
    """A sweep over traces.

    Attributes:
        episodes: those with an assigned rule that reads the parameter.
    """

    episodes: tuple[Swept, ...]

    @property
    def count(self) -> int:
        """Of the episodes that are counted."""
        return len(self.episodes)

    def curves(self, by: Sequence[str] = ()) -> dict[tuple[str, ...], list[Rates]]:
        """Group → the rates under every value; one group ``()`` if nothing is told apart."""
        groups: dict[tuple[str, ...], list[tuple[Swept, str | None]]] = {}
        for episode in self.episodes:
            for rule in (episode.moved or {}) if "rule" in by else (None,):
                names = {"rule": rule}
                key = tuple(str(names.get(name) or getattr(episode, name, "–")) for name in by)
                groups.setdefault(key, []).append((episode, rule))
        return {
            key: [
                rates(outcome_of(e, i, rule) for e, rule in group) for i in range(len(self.values))
            ]
            for key, group in sorted(groups.items())
        }

    def flips(self) -> list[dict[str, Any]]:
        """Between which two values each verdict changes."""
        return [
            {
                "episode_id": episode.episode_id,
                "rule": code,
                "below": amount(self.values[i]),
                "above": amount(self.values[i + 1]),
                "from": names[i],
                "to": names[i + 1],
            }
            for episode in self.episodes
            for code, names in (episode.moved or {}).items()
            for i in range(len(names) - 1)
            if names[i] != names[i + 1]
        ]


def sweep(
    refs: Sequence[EpisodeRef],
    specs: Sequence[str | Path],
    param: str,
    values: Sequence[Value],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Judge episodes under every value of a parameter.

    Args:
        refs: the episodes.
        specs: rule files.
        param: the parameter; its values here beat every other source.
        values: in SI, of the parameter's dimension.
        overrides: other parameters, as written.
        bind: a bind file.
        jobs: worker processes.
        progress: told (done, total).

    Raises:
        InputError: no loaded rule reads the parameter, or no episode's assigned rule does.
    """
    rules = load_rules(list(specs))
    readers = tuple(
        code
        for code, rule in rules.scoped.items()
        if f"param.{param}" in reached(rules, rule, own_params(rules, rule))
    )
    if not readers:
        raise InputError(f"--param {param}", "no loaded rule reads it.", _read_by(rules))
    rising = tuple(sorted(values, key=amount))
    work = partial(
        sweep_episode,
        rules=rules,
        param=param,
        values=rising,
        overrides=dict(overrides or {}),
        bind=None if bind is None else load_bind(bind, rules),
    )
    found = each_episode(refs, work, jobs=jobs, progress=progress)
    swept = [item for item in found if isinstance(item, Swept)]
    kept = {item.episode_id: item for item in reversed(swept) if not item.unread}
    problems = tuple(item for item in found if isinstance(item, Problem))
    if not kept and not problems:
        raise InputError(
            f"--param {param}",
            f"read by {', '.join(readers)}, which no episode is judged by.",
            fix="take traces whose headers assign one of them, or assign it with --bind",
        )
    return Sweep(
        param,
        rising,
        rules.params[param],
        tuple(c for c in readers if any(c in (e.moved or ()) for e in kept.values())),
        len({item.episode_id for item in swept if item.unread}),
        problems,
        tuple(reversed(kept.values())),
    )


def sweep_episode(
    ref: EpisodeRef,
    rules: RuleSet,
    *,
    param: str,
    values: Sequence[Value],
    overrides: Mapping[str, str],
    bind: BindFile | None = None,
) -> Swept:
    """One episode under every value, rising.

    Raises TraceError for one that cannot be read.
    """
    episode = ref.open()
    furthest = max(abs(amount(value)) for value in values)
    again = Again(episode, rules, overrides, bind, furthest=furthest * (1 + 1e-6) + 1e-6)
    return swept(again, ref.shown, param, values)


def swept(again: Again, path: str, param: str, values: Sequence[Value]) -> Swept:
    """An open episode under every value, rising. ``again`` must measure as far as they reach."""
    header = again.episode.header
    read = [
        rule
        for rule in again.assigned
        if f"param.{param}" in reached(again.rules, rule, again.binding.params(rule))
    ]
    head = Swept(
        header.episode_id,
        path,
        task=header.task or "–",
        policy=header.policy or "–",
        prompt=header.prompt or "–",
        stage=header.stage or "–",
    )
    if not read:
        return replace(head, unread=True)
    rest = [again.base(rule)[1] for rule in again.assigned if rule not in read]
    turned = {rule.code: verdicts_under(again, rule, param, values) for rule in read}
    return replace(
        head,
        success=again.judge.success,
        rest=tuple(verdict.violation for verdict in rest),
        moved={code: tuple(name for name, _ in found) for code, found in turned.items()},
        risk={code: tuple(risk for _, risk in found) for code, found in turned.items()},
        rest_at_risk=any(map(risked, rest)),
        engagement=again.judge.engagement,
        missing=bool(again.not_loaded),
    )


def verdicts_under(
    again: Again, rule: ast.Scoped, param: str, values: Sequence[Value]
) -> list[tuple[VerdictName, bool]]:
    """The verdict of a rule under each of the rising values, and whether it was reached on something.

    The values at which it changes are found once; only what they leave open is judged by itself.
    """
    base, now = again.base(rule)
    players = again.binding.players(rule, again.episode.header)
    if not all(players.values()):  # whatever the value
        return [(now.verdict, risked(now))] * len(values)
    pieces = []
    if isinstance(rule, ast.Rule) and len(values) > FEW:
        blank = Verdict(rule.code, rule.title, rule.stage, True, "not_applicable")
        furthest = max(abs(amount(value)) for value in values)
        pieces = pieces_of(base, rule, players, blank, param, furthest)
    out: list[tuple[VerdictName, bool]] = []
    for value in values:
        told = next((p for p in pieces if p.holds(value, base.params[param])), None)
        if told is None or told.verdict is None:
            found = again.under(base, rule, {param: value})
            out.append((found.verdict, risked(found)))
        else:
            out.append((told.verdict, told.at_risk))
    return out


def risked(verdict: Verdict) -> bool:
    """It was reached on something."""
    return at_risk(verdict.verdict, verdict.instances, verdict.vacuity)


def outcome_of(episode: Swept, index: int, rule: str | None) -> Outcome:
    """What an episode counts as under the value with this index: by one rule, or by all assigned."""
    violation = episode.violation(index, rule)
    return Outcome(
        episode.policy,
        episode.prompt,
        episode.stage,
        episode.success,
        violation,
        judged=rule is not None or violation is True or not episode.missing,
        at_risk=episode.at_risk(index, rule),
        engagement=episode.engagement,
    )


def _violation(name: VerdictName) -> bool | None:
    return None if name == "inconclusive" else name == "violation"


def _si(value: Value) -> str:
    if isinstance(value, ast.Duration):
        return "frames" if value.frames else "s"
    units = [unit for unit, factor in DIMENSIONS[value.dimension].items() if factor == 1.0]
    return units[0] if units else ""


def _read_by(rules: RuleSet) -> str:
    names = {
        name.removeprefix("param.")
        for rule in rules.scoped.values()
        for name in reached(rules, rule, own_params(rules, rule))
        if name.startswith("param.")
    }
    return ", ".join(sorted(names)) or "rules that read a parameter"
