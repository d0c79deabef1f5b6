"""Stretches of rising values of a parameter under which a rule gives one verdict on an episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import polars as pl

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.bind_file import BindFile
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.verdict import Verdict, VerdictName, at_risk

from .flips import pieces_of
from .judge_again import Again

FEW = 4
"""Number of values up to which each is judged by itself."""

OPEN = "–"
"""Stands for a field that a header leaves empty."""

KEYS = ("episode_id", "rule")
FIELDS = ("policy", "prompt", "stage", "task")
"""Fields of an episode by which curves can be grouped, besides the rule."""
NO, UNKNOWN, YES = 0, 1, 2
"""Codes of V: not violated, inconclusive, violated; of several rules the greatest counts."""
CODES: Mapping[str | None, int] = {
    "pass": NO, "not_applicable": NO, "inconclusive": UNKNOWN, None: UNKNOWN, "violation": YES,
}  # fmt: skip
"""Verdict → code; None: not decided."""

SEGMENTS = pl.Schema(
    {
        "episode_id": pl.String(),
        "rule": pl.String(),
        "verdict": pl.String(),
        "risk": pl.Boolean(),
        "first": pl.Int64(),
        "stop": pl.Int64(),
        "code": pl.Int8(),
        "policy": pl.String(),
        "prompt": pl.String(),
        "stage": pl.String(),
        "task": pl.String(),
        "success": pl.Boolean(),
        "engagement": pl.String(),
        "missing": pl.Boolean(),
        "rest": pl.Int8(),
        "rest_at_risk": pl.Boolean(),
    }
)
"""A segment: the values ``first`` … ``stop`` − 1 under which a rule gives one verdict on one episode.

``verdict`` is null where it is not decided, ``risk`` says whether the hazard was there (``at_risk``),
``code`` is that of the verdict. ``missing``: an assigned rule of the episode is not loaded. ``rest``
and ``rest_at_risk`` are the greatest code and any risk of its assigned rules that do not read the
parameter.
"""

Segment = tuple[Any, ...]
"""A row of ``SEGMENTS``."""


def segment_frame(rows: Sequence[Segment]) -> pl.DataFrame:
    """Segments as a table."""
    return pl.DataFrame(rows, SEGMENTS, orient="row")


def sweep_episode(
    ref: EpisodeRef,
    rules: RuleSet,
    *,
    param: str,
    values: Sequence[ast.Setting],
    overrides: Mapping[str, str],
    bind: BindFile | None = None,
) -> tuple[str, list[Segment]]:
    """Id and segments of one episode; no segments if no assigned rule reads the parameter.

    ``values`` are rising. Raises TraceError for an episode that cannot be read.
    """
    episode = ref.open()
    furthest = max(abs(amount(value)) for value in values)
    again = Again(episode, rules, overrides, bind, furthest=furthest * (1 + 1e-6) + 1e-6)
    return episode.header.episode_id, segments_of(again, param, values)


def segments_of(again: Again, param: str, values: Sequence[ast.Setting]) -> list[Segment]:
    """Segments of an open episode over rising values; ``again`` must measure as far as they reach."""
    header = again.episode.header
    read = [rule for rule in again.assigned if param in parameters_read(again.rules, rule)]
    if not read:
        return []
    rest = [again.base(rule)[1] for rule in again.assigned if rule not in read]
    facts = (
        *(getattr(header, name) or OPEN for name in FIELDS),
        again.judge.success,
        again.judge.engagement,
        bool(again.not_loaded),
        max((CODES[verdict.verdict] for verdict in rest), default=NO),
        any(_risk(verdict) for verdict in rest),
    )
    out: list[Segment] = []
    for rule in read:
        first = 0
        for (verdict, risk), same in groupby(_under_each(again, rule, param, values)):
            stop = first + len(list(same))
            start = (header.episode_id, rule.code, verdict, risk, first, stop, CODES[verdict])
            out.append((*start, *facts))
            first = stop
    return out


def _under_each(
    again: Again, rule: ast.Scoped, param: str, values: Sequence[ast.Setting]
) -> list[tuple[VerdictName, bool]]:
    """The verdict of a rule under each of the rising values, and whether the hazard was there.

    The values at which it changes are found once; only those that they leave open are judged one by
    one.
    """
    base, now = again.base(rule)
    players = again.binding.players(rule, again.episode.header)
    if not all(players.values()):  # whatever the value
        return [(now.verdict, _risk(now))] * len(values)
    pieces = []
    if isinstance(rule, ast.Rule) and len(values) > FEW:
        furthest = max(abs(amount(value)) for value in values)
        pieces = pieces_of(base, rule, players, param, furthest)
    out: list[tuple[VerdictName, bool]] = []
    for value in values:
        piece = next((p for p in pieces if p.holds(value, base.params[param])), None)
        if piece is None or piece.verdict is None:
            verdict = again.under(base, rule, {param: value})
            out.append((verdict.verdict, _risk(verdict)))
        else:
            out.append((piece.verdict, piece.at_risk))
    return out


def _risk(verdict: Verdict) -> bool:
    return at_risk(verdict.verdict, verdict.instances, verdict.vacuity)
