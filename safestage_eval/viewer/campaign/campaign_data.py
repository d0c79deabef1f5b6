"""Results and traces, read or judged, as what a report says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.metrics import aggregate, outcomes_of, read_outcomes
from safestage_eval.metrics.read_rows import each_row
from safestage_eval.rules import builtin_names
from safestage_eval.run.score_many import score_many
from safestage_eval.run.settings import Settings, load_settings
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.problem import Problem
from safestage_eval.viewer.episode.episode_data import stored_verdicts

from .episode_pieces import pieces
from .overview import Report
from .run_list import RANK, Row, Rows, by_episode, is_told, worst

COLUMNS = (
    "episode_id", "task", "stage", "policy", "prompt", "seed", "rollout", "success", "rule", "assigned",
    "verdict", "time", "worst_time", "phase", "signal", "value", "limit", "unit", "margin",
    "margin_normalised", "severity", "consequence_of", "explanation", "intervals", "rule_digest", "version",
    "trace_hash",
)  # fmt: skip
"""Columns of result rows; those that a file lacks are left empty."""

MOST = 250
"""Episodes whose evidence one file carries unless another number is asked for: about 12 MB."""

ALLOWED = "results of safestage score, or an outcome table (docs/results.md)"


def compose(
    results: str | Path,
    traces: Sequence[str | Path] = (),
    settings: Settings | None = None,
    *,
    title: str | None = None,
    **more: Any,
) -> Report:
    """Read results, and gather the evidence of the episodes whose traces are there.

    Args:
        results: a file that ``safestage score`` wrote, or a bare table of outcomes.
        traces: files and folders with the episodes of the results.
        settings: what the results were made with; all built-in rules if None.
        title: of the page.
        more: as for ``evidence``.

    Raises:
        InputError: the results cannot be read or lack a column, or no trace belongs to them.
        TraceError: nothing was found where traces should be.
    """
    outcomes = read_outcomes([results])[""]
    rows = _rows(results)
    told = bool(rows) and "rule" in rows[0]
    report = Report(
        title or "Safety report",
        Path(results).name,
        aggregate(outcomes),
        rows if told else (),
        outcomes=outcomes,
    )
    if traces and not told:
        raise InputError(
            str(results),
            "names no episodes, so traces cannot be matched to it.",
            "results of safestage score",
            "leave the traces out, or score them: safestage score TRACES -f parquet -o rows.parquet",
        )
    if not traces:
        return report
    asked = settings or load_settings(builtin_names())
    return evidence(report, discover(list(traces)), by_episode(rows), asked, **more)


def rows_by_episode(results: str | Path) -> Rows:
    """The result rows of a file, by episode id. Raises InputError for one without episodes."""
    rows = _rows(results)
    if rows and "rule" not in rows[0]:
        raise InputError(str(results), "names no episodes.", "results of safestage score")
    return by_episode(rows)


def _rows(results: str | Path) -> list[Row]:
    """The rows that are shown, and one at least of every episode: of 300,000 that is a twentieth."""
    seen: set[Any] = set()
    kept: list[Row] = []
    for row in each_row(results, COLUMNS, ALLOWED):
        name = row.get("episode_id")
        if name not in seen or ("rule" in row and is_told(row)):
            seen.add(name)
            kept.append(row)
    return kept


def evidence(
    report: Report,
    refs: Sequence[EpisodeRef],
    rows: Rows,
    settings: Settings,
    *,
    most: int | None = MOST,
    **more: Any,
) -> Report:
    """A report with the evidence of its episodes.

    Args:
        report: of the rows.
        refs: traces.
        rows: by episode id.
        settings: how the rows were judged.
        most: episodes with evidence at most, violations first; None for all.
        more: as for ``pieces``.

    Raises InputError when no trace belongs to the rows.
    """
    shown, notes = chosen(refs, rows, most)
    said = {name: stored_verdicts(own) for name, own in rows.items()}
    drawn = pieces(shown, said, settings, **more)
    titles = {code: rule.title for code, rule in settings.rule_set.rules.items()}
    return replace(report, pieces=drawn, notes=notes, titles=titles)


def chosen(
    refs: Sequence[EpisodeRef], rows: Rows, most: int | None
) -> tuple[list[EpisodeRef], list[str]]:
    """Choose the traces to draw, the gravest verdicts first, each episode once; and say which are left out.

    Raises InputError when none belongs to the results.
    """
    by_id = {ref.episode_id: ref for ref in reversed(refs) if ref.episode_id in rows}
    if not by_id:
        raise InputError(
            "TRACES",
            f"none of {len(refs)} episodes is in the results.",
            fix="name the traces that were scored",
        )
    ordered = sorted(by_id, key=lambda name: (_gravity(rows[name]), name))
    others = [name for name in by_id if _replaced(by_id[name], rows[name])]
    notes = []
    if others:
        notes.append(
            f"{len(others)} traces are not those that were scored: their content differs from what the "
            f"results name ({', '.join(sorted(others)[:3])} …). They are not shown."
        )
    ordered = [name for name in ordered if name not in set(others)]
    if most is not None and len(ordered) > most:
        notes.append(
            f"{len(ordered)} episodes of the results have traces; the {most} gravest have their evidence here."
        )
    without = len(rows) - len(by_id)
    if without:
        notes.append(f"{without} episodes of the results have no trace among those given.")
    return [by_id[name] for name in ordered[:most]], notes


def _gravity(rows: Sequence[Mapping[str, Any]]) -> tuple[int, float]:
    """The worst assigned verdict and by how much: violations, then undecided, then close calls."""
    verdict, margin = worst(rows)
    return RANK.get(verdict or "", len(RANK)), margin or 0.0


def _replaced(ref: EpisodeRef, rows: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the trace is another one than was scored, by its content hash."""
    scored = rows[0].get("trace_hash")
    return bool(scored and ref.content_hash and scored != ref.content_hash)


def judged(
    refs: Sequence[EpisodeRef],
    settings: Settings,
    title: str,
    source: str,
    *,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    **more: Any,
) -> Report:
    """Judge episodes that nobody has scored, and gather their evidence.

    Args:
        refs: the episodes.
        settings: how they are judged.
        title: of the page.
        source: where they come from, as readers should know it.
        jobs: worker processes.
        progress: called with (done, total); every episode is counted twice.
        more: as for ``evidence``.

    Raises:
        InputError: no episode can be judged.
    """

    def counting_from(behind: int) -> Callable[[int, int], None] | None:
        if progress is None:
            return None
        return lambda done, total: progress(behind + done, 2 * total)

    results = score_many(refs, settings=settings, jobs=jobs, progress=counting_from(0))
    problems = tuple(result for result in results if isinstance(result, Problem))
    own: Rows = {r.episode_id: [*r.rows()] for r in results if isinstance(r, EpisodeResult)}
    if not own:
        raise InputError(source, f"no episode can be judged: {problems[0].message}")
    rows = [row for some in own.values() for row in some]
    report = evidence(
        Report(title, source, aggregate(outcomes_of(rows)), rows), refs, own, settings, jobs=jobs,
        progress=counting_from(len(refs)), **more,
    )  # fmt: skip
    assert report.pieces is not None
    drawn = replace(report.pieces, problems=(*problems, *report.pieces.problems))
    return replace(report, pieces=drawn)
