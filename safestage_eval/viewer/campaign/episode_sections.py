"""Open, draw and sweep many episodes: once each, in one process or several."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet, load_bind, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.players import nodes
from safestage_eval.verdicts.problem import Problem
from safestage_eval.viewer.episode.episode_section import StoredVerdicts, section
from safestage_eval.whatif.each_episode import each_episode
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.sweep import Segment, Sweep, segment_frame, segments_of
from safestage_eval.whatif.swept_values import between

from .packed import packed

STEPS = 41
"""Values of a limit that are visited, from nothing to twice its default."""

DRAWN = 4
"""Limits whose sensitivity is drawn: those on which most verdicts depend."""


@dataclass(frozen=True)
class Sections:
    """Sections drawn from the traces.

    Attributes:
        html: episode id → its section, compressed.
        sweeps: limits against rates.
        differences: episode id → where results and rules disagree.
        problems: what could not be opened or judged.
    """

    html: Mapping[str, str]
    sweeps: tuple[Sweep, ...]
    differences: Mapping[str, tuple[str, ...]]
    problems: tuple[Problem, ...]


@dataclass(frozen=True)
class Drawn:
    """One episode: its section, and by parameter its segments under other limits."""

    episode_id: str
    html: str
    differences: tuple[str, ...]
    swept: Mapping[str, Sequence[Segment]]


def sections(
    refs: Sequence[EpisodeRef],
    said: Mapping[str, StoredVerdicts],
    specs: Sequence[str | Path],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Sections:
    """Draw episodes and determine on which limits their verdicts depend.

    Args:
        refs: the episodes.
        said: episode id → what the results say of it.
        specs: rule files.
        overrides: parameters, as written; these are not swept.
        bind: a bind file.
        jobs: worker processes.
        progress: called with (done, total).

    Raises RuleErrors, RuleError, InputError as ``scoring.score_many``.
    """
    rules = load_rules(list(specs))
    visited = {
        name: tuple(sorted(between(rules, name, None, None, STEPS), key=amount))
        for name in {name for rule in rules.rules.values() for name in limits(rule)}
        if amount(rules.params[name]) > 0 and name not in (overrides or {})
    }
    work = partial(
        draw,
        rules=rules,
        said=dict(said),
        visited=visited,
        overrides=dict(overrides or {}),
        bind=None if bind is None else load_bind(bind, rules),
    )
    drawn, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    return Sections(
        {item.episode_id: item.html for item in drawn},
        _sweeps(rules, visited, drawn),
        {item.episode_id: item.differences for item in drawn if item.differences},
        tuple(problems),
    )


def draw(
    ref: EpisodeRef,
    rules: RuleSet,
    said: Mapping[str, StoredVerdicts],
    visited: Mapping[str, tuple[ast.Setting, ...]],
    overrides: Mapping[str, str],
    bind: BindFile | None,
) -> Drawn:
    """Draw and sweep one episode. Raises TraceError for one that cannot be read."""
    episode = ref.open()
    furthest = max(
        (amount(v) for values in visited.values() for v in values[-1:] if _is_length(v)),
        default=0.0,
    )
    again = Again(episode, rules, overrides, bind, furthest=furthest * (1 + 1e-6) + 1e-6)
    name = episode.header.episode_id
    html, differences = section(again, said.get(name, StoredVerdicts({})))
    read = {
        param for rule in again.assigned if isinstance(rule, ast.Rule) for param in limits(rule)
    }
    moved = {
        param: segments_of(again, param, visited[param]) for param in sorted(read & visited.keys())
    }
    return Drawn(name, packed(html), differences, moved)


def limits(rule: ast.Rule) -> set[str]:
    """Parameters that a rule compares a measurement with."""
    return {
        node.name
        for clause in rule.clauses
        for atom in nodes(clause.what)
        if isinstance(atom, ast.SignalAtom)
        for limit in atom.limits
        for node in [limit.value]
        if isinstance(node, ast.Parameter)
    }


def _is_length(value: ast.Setting) -> bool:
    return isinstance(value, ast.Quantity) and value.dimension == "length"


def _sweeps(
    rules: RuleSet, visited: Mapping[str, tuple[ast.Setting, ...]], drawn: Sequence[Drawn]
) -> tuple[Sweep, ...]:
    """The limits at which most verdicts flip."""
    sweeps = []
    flips: Counter[str] = Counter()
    for param, values in visited.items():
        segments = segment_frame([row for item in drawn for row in item.swept.get(param, ())])
        codes = tuple(sorted(set(segments["rule"])))
        unread = len(drawn) - segments["episode_id"].n_unique()
        sweep = Sweep(param, values, rules.params[param], codes, unread, (), segments)
        flips[param] = len(sweep.flips())
        if flips[param]:
            sweeps.append(sweep)
    sweeps.sort(key=lambda sweep: (-flips[sweep.param], sweep.param))
    return tuple(sweeps[:DRAWN])
