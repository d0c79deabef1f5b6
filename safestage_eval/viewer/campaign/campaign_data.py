"""Read results, and traces if there are any, into the contents of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.metrics import aggregate, read_outcomes
from safestage_eval.metrics.read_rows import read_rows
from safestage_eval.rules import builtin_names
from safestage_eval.viewer.episode.episode_section import stored_verdicts

from .campaign_page import Report
from .episode_sections import sections

COLUMNS = (
    "episode_id", "task", "stage", "policy", "prompt", "seed", "rollout", "success", "rule", "assigned",
    "verdict", "time", "worst_time", "phase", "signal", "value", "limit", "unit", "margin",
    "margin_normalised", "severity", "consequence_of", "explanation", "intervals", "rule_digest", "version",
    "trace_hash",
)  # fmt: skip
"""Columns of result rows; those that a file lacks are left empty."""

MOST = 500
"""Sections that are drawn unless another number is asked for."""

ALLOWED = "results of safestage score, or an outcome table (docs/results.md)"

Rows = dict[str, list[Mapping[str, Any]]]


def compose(
    results: str | Path,
    traces: Sequence[str | Path] = (),
    rules: Sequence[str | Path] = (),
    *,
    title: str | None = None,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    most: int = MOST,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Report:
    """Read results, and draw the episodes whose traces are there.

    Args:
        results: a file that ``safestage score`` wrote, or a bare table of outcomes.
        traces: files and folders with the episodes of the results.
        rules: rule files by which the results were made; all built-in ones if empty.
        title: of the page.
        overrides: parameters, as written, that the results were made with.
        bind: the bind file that they were made with.
        most: sections at most; violations come first.
        jobs: worker processes.
        progress: called with (done, total) episodes.

    Raises:
        InputError: the results cannot be read or lack a column, or no trace belongs to them.
        TraceError: nothing was found where traces should be.
    """
    outcomes = read_outcomes([results])[""]
    counts = aggregate(outcomes)
    name = Path(results).name
    heading = title or "Safety report"
    rows = read_rows(results, COLUMNS, ALLOWED)
    if not rows or "rule" not in rows[0]:
        if traces:
            raise InputError(
                str(results),
                "names no episodes, so traces cannot be matched to it.",
                "results of safestage score",
                "leave the traces out, or score them: safestage score TRACES -f parquet -o rows.parquet",
            )
        return Report(heading, name, counts, outcomes=outcomes)
    if not traces:
        return Report(heading, name, counts, rows)
    by_episode: Rows = {}
    for row in rows:
        by_episode.setdefault(str(row["episode_id"]), []).append(row)
    refs, notes = chosen(discover(list(traces)), by_episode, most)
    drawn = sections(
        refs,
        {ref.episode_id: stored_verdicts(by_episode[ref.episode_id]) for ref in refs},
        list(rules) or builtin_names(),
        overrides=overrides,
        bind=bind,
        jobs=jobs,
        progress=progress,
    )
    return Report(heading, name, counts, rows, sections=drawn, notes=notes)


def chosen(
    refs: Sequence[EpisodeRef], by_episode: Rows, most: int
) -> tuple[list[EpisodeRef], list[str]]:
    """Choose the traces to draw, the gravest verdicts first, each episode once; and say which are left out.

    Raises InputError when none belongs to the results.
    """
    by_id = {ref.episode_id: ref for ref in reversed(refs) if ref.episode_id in by_episode}
    if not by_id:
        raise InputError(
            "TRACES",
            f"none of {len(refs)} episodes is in the results.",
            fix="name the traces that were scored",
        )
    ordered = sorted(by_id, key=lambda name: (_gravity(by_episode[name]), name))
    others = [name for name in by_id if _replaced(by_id[name], by_episode[name])]
    notes = []
    if others:
        notes.append(
            f"{len(others)} traces are not those that were scored: their content differs from what the "
            f"results name ({', '.join(sorted(others)[:3])} …). They are not drawn."
        )
    ordered = [name for name in ordered if name not in set(others)]
    if len(ordered) > most:
        notes.append(
            f"{len(ordered)} episodes of the results have traces; the {most} gravest are drawn."
        )
    without = len(by_episode) - len(by_id)
    if without:
        notes.append(f"{without} episodes of the results have no trace among those given.")
    return [by_id[name] for name in ordered[:most]], notes


def _gravity(rows: Sequence[Mapping[str, Any]]) -> tuple[int, float]:
    """The worst assigned verdict and by how much: violations, then undecided, then close calls."""
    own = [row for row in rows if row["assigned"] and row["verdict"] is not None]
    worst = min((_RANK.get(row["verdict"], 3) for row in own), default=4)
    margins = [row.get("margin_normalised") for row in own if _RANK.get(row["verdict"]) == worst]
    return worst, min((float(m) for m in margins if m is not None), default=0.0)


_RANK = {"violation": 0, "inconclusive": 1, "pass": 2, "not_applicable": 3}


def _replaced(ref: EpisodeRef, rows: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the trace is another one than was scored, by its content hash."""
    scored = rows[0].get("trace_hash")
    return bool(scored and ref.content_hash and scored != ref.content_hash)
