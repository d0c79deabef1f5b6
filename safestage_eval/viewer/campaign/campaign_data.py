"""Results and traces, read or judged, as what a report says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.metrics import aggregate, outcomes_of, read_outcomes
from safestage_eval.metrics.read_rows import read_rows
from safestage_eval.rules import RuleSet, builtin_names, load_bind, load_rules
from safestage_eval.run.score_many import score_many
from safestage_eval.run.settings import Settings
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.problem import Problem
from safestage_eval.viewer.episode.stored_verdicts import stored_verdicts

from .episode_pieces import pieces
from .overview import Report
from .run_list import RANK, worst

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

Rows = dict[str, list[Mapping[str, Any]]]


def compose(
    results: str | Path,
    traces: Sequence[str | Path] = (),
    rules: Sequence[str | Path] = (),
    *,
    title: str | None = None,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    most: int | None = MOST,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    folder: Path | None = None,
) -> Report:
    """Read results, and gather the evidence of the episodes whose traces are there.

    Args:
        results: a file that ``safestage score`` wrote, or a bare table of outcomes.
        traces: files and folders with the episodes of the results.
        rules: rule files by which the results were made; all built-in ones if empty.
        title: of the page.
        overrides: parameters, as written, that the results were made with.
        bind: the bind file that they were made with.
        most: episodes with evidence at most, violations first; None for all.
        jobs: worker processes.
        progress: called with (done, total) episodes.
        folder: where the evidence is written; None: it is kept.

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
    loaded = load_rules(list(rules) or builtin_names())
    drawn = pieces(
        refs,
        {ref.episode_id: stored_verdicts(by_episode[ref.episode_id]) for ref in refs},
        loaded,
        overrides=overrides,
        bind=None if bind is None else load_bind(bind, loaded),
        jobs=jobs,
        progress=progress,
        folder=folder,
    )
    return Report(heading, name, counts, rows, pieces=drawn, notes=notes, titles=_titles(loaded))


def _titles(rules: RuleSet) -> dict[str, str]:
    return {code: rule.title for code, rule in rules.rules.items()}


def rows_by_episode(results: str | Path) -> Rows:
    """The result rows of a file, by episode id. Raises InputError for one without episodes."""
    rows = read_rows(results, COLUMNS, ALLOWED)
    if rows and "rule" not in rows[0]:
        raise InputError(str(results), "names no episodes.", "results of safestage score")
    by_episode: Rows = {}
    for row in rows:
        by_episode.setdefault(str(row["episode_id"]), []).append(row)
    return by_episode


def chosen(
    refs: Sequence[EpisodeRef], by_episode: Rows, most: int | None
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
            f"results name ({', '.join(sorted(others)[:3])} …). They are not shown."
        )
    ordered = [name for name in ordered if name not in set(others)]
    if most is not None and len(ordered) > most:
        notes.append(
            f"{len(ordered)} episodes of the results have traces; the {most} gravest have their evidence here."
        )
    without = len(by_episode) - len(by_id)
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
    most: int | None = MOST,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    folder: Path | None = None,
    everything: bool = False,
    sweep: bool = True,
) -> Report:
    """Judge episodes that nobody has scored, and gather their evidence.

    Args:
        refs: the episodes.
        settings: how they are judged.
        title: of the page.
        source: where they come from, as readers should know it.
        most: episodes with evidence at most, violations first; None for all.
        jobs: worker processes.
        progress: called with (done, total); every episode is counted twice.
        folder: where the evidence is written; None: it is kept.
        everything: rules that pass without being assigned as well.
        sweep: find out on which limits verdicts depend.

    Raises:
        InputError: no episode can be judged.
    """

    def counting_from(behind: int) -> Callable[[int, int], None] | None:
        if progress is None:
            return None
        return lambda done, total: progress(behind + done, 2 * total)

    results = score_many(refs, settings=settings, jobs=jobs, progress=counting_from(0))
    problems = tuple(result for result in results if isinstance(result, Problem))
    rows = [row for result in results if isinstance(result, EpisodeResult) for row in result.rows()]
    done = {result.episode_id for result in results if isinstance(result, EpisodeResult)}
    if not done:
        raise InputError(source, f"no episode can be judged: {problems[0].message}")
    by_episode: Rows = {name: [] for name in done}
    for row in rows:
        by_episode[str(row["episode_id"])].append(row)
    shown, notes = chosen(refs, by_episode, most)
    drawn = pieces(
        shown,
        {name: stored_verdicts(own) for name, own in by_episode.items()},
        settings.rule_set,
        overrides=settings.overrides,
        bind=settings.bind,
        jobs=jobs,
        progress=counting_from(len(refs)),
        folder=folder,
        everything=everything,
        sweep=sweep,
    )
    drawn = replace(drawn, problems=(*problems, *drawn.problems))
    counts = aggregate(outcomes_of(rows))
    return Report(
        title, source, counts, rows, pieces=drawn, notes=notes, titles=_titles(settings.rule_set)
    )
