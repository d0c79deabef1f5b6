"""The results of a run, each episode counted once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from safestage_eval.errors import InputError
from safestage_eval.metrics.by_rule import RuleCount, by_rule, set_aside
from safestage_eval.verdicts.problem import Problem

from .gates import Gates

if TYPE_CHECKING:
    from safestage_eval.rules import RuleSet
    from safestage_eval.verdicts import EpisodeResult


@dataclass(frozen=True)
class Scores:
    """Everything that scoring came to, in the order in which the episodes were found.

    Attributes:
        results: of the episodes that could be judged; those of a long run stay on disk and are
            read as they are looked at.
        problems: the others.
        rules: code → title of the rules that were loaded.
        reasons: code → why the rule matters, for those that say so.
        copies: files that hold an episode which another one holds as well, bit for bit; counted
            once.
        aborted: ids of rollouts that ended in an error (of a server, say): not judged.
        sample: which share of the episodes was judged, in words; empty if all were.
        gates: which verdicts count where a build may fail.
        audit: counts and findings of an audit, as JSON values; None if there was none.
        strict: rules that these recordings can never decide leave their episodes undecided, instead
            of being set aside.
    """

    results: Sequence[EpisodeResult] = ()
    problems: tuple[Problem, ...] = ()
    rules: Mapping[str, str] = field(default_factory=dict)
    copies: tuple[str, ...] = ()
    aborted: tuple[str, ...] = ()
    sample: str = ""
    gates: Gates = field(default_factory=Gates)
    audit: Mapping[str, Any] | None = None
    reasons: Mapping[str, str] = field(default_factory=dict)
    strict: bool = False

    @cached_property
    def by_rule(self) -> list[RuleCount]:
        """How the rules that count fared."""
        counts = by_rule(map(self.gates.counted, self.results))
        return [replace(count, set_aside=False) for count in counts] if self.strict else counts

    @cached_property
    def set_aside(self) -> frozenset[str]:
        """Codes of the rules that rates leave out, for nothing in these recordings can decide them."""
        return set_aside(self.by_rule)


def titles(rules: RuleSet) -> dict[str, str]:
    """Code → title of all rules and costs."""
    by_code = {rule.code: rule.title for rule in rules.rules.values()}
    return by_code | {cost.code: cost.title for cost in rules.costs.values()}


def reasons(rules: RuleSet) -> dict[str, str]:
    """Code → why it matters, of the rules and costs that say so."""
    both = (*rules.rules.values(), *rules.costs.values())
    return {each.code: each.why for each in both if each.why}


def deduplicate(
    found: Iterable[EpisodeResult | Problem],
) -> tuple[list[EpisodeResult], list[Problem], list[str]]:
    """Each episode once; what could not be judged, or has the id of another; paths of copies."""
    results: dict[str, EpisodeResult] = {}
    problems, copies = [], []
    for item in found:
        if isinstance(item, Problem):
            problems.append(item)
            continue
        first = results.setdefault(item.episode_id, item)
        if first is item:
            continue
        if first.trace_hash == item.trace_hash:
            copies.append(item.path)
            continue
        problems.append(taken(item.episode_id, item.path, first.path))
    return [*results.values()], problems, copies


def taken(episode_id: str, path: str, first: str) -> Problem:
    """Message about two episodes with the same id."""
    error = InputError(
        path,
        f"the id {episode_id!r} is taken by another episode, in {first}.",
        fix="give each episode its own id",
    )
    return Problem(path, str(error))
