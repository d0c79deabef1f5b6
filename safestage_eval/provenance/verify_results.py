"""Whether results are those of the traces: digests are computed anew, and a sample is judged again."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.evidence.trace_identity import code_version
from safestage_eval.formats import EpisodeRef
from safestage_eval.metrics.read_rows import read_rows
from safestage_eval.run.score_episode import score_episode
from safestage_eval.run.settings import Settings
from safestage_eval.verdicts.problem import Problem
from safestage_eval.version import __version__

from .manifest import digest_of, opened

COMPARED = (
    "verdict", "violation", "assigned", "time", "value", "limit", "margin", "rule_digest",
    "success", "trace_hash",
)  # fmt: skip
"""Columns of a row that judging again has to give."""
_TRUE = {"true": True, "false": False}


@dataclass
class Verification:
    """Outcome of verifying.

    Attributes:
        rows: in the results.
        episodes: of which there are results.
        digests: episodes whose digests were computed.
        judged: episodes that were judged again.
        differences: what is not as the results or their manifest say, a sentence each.
        missing: episodes that could not be verified, a sentence each.
        notes: what differs without being wrong.
    """

    rows: int = 0
    episodes: int = 0
    digests: int = 0
    judged: int = 0
    differences: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def exit_code(self) -> int:
        """0: everything is as stated; 1: something differs; 2: something could not be verified."""
        return 1 if self.differences else 2 if self.missing else 0


def verify(
    results: Path,
    refs: Iterable[EpisodeRef],
    settings: Settings,
    *,
    statement: Mapping[str, Any] | None = None,
    sample: int | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Verification:
    """Compare results with traces.

    Args:
        results: file of rows, in any format that ``score`` writes them in.
        refs: the episodes.
        settings: how they were judged.
        statement: the manifest of the results; None without one.
        sample: episodes to judge again; None: all.
        seed: chooses them.
        progress: called with (done, total) of the episodes.

    Raises:
        InputError: results that cannot be read.
    """
    verification = Verification()
    by_episode: dict[str, list[dict[str, Any]]] = {}
    for row in read_rows(results):
        by_episode.setdefault(str(row.get("episode_id")), []).append(row)
        verification.rows += 1
    verification.episodes = len(by_episode)
    if not by_episode and statement is None:
        raise InputError(str(results), "it has no rows.", "results of: safestage score")
    stated = _compare_manifest(verification, results, settings, statement)
    for name in sorted(stated.keys() ^ by_episode.keys()) if statement is not None else ():
        place = "the manifest" if name in stated else "the results"
        verification.differences.append(f"{name}: is in {place} alone")
    stored = {ref.episode_id: ref for ref in refs}
    names = sorted(by_episode)
    chosen = set(random.Random(seed).sample(names, min(sample, len(names)))) if sample is not None else set(names)  # noqa: S311 # fmt: skip
    for done, name in enumerate(names, 1):
        _verify_one(
            verification, name, by_episode[name], stored.get(name), stated.get(name), settings,
            judge=name in chosen,
        )  # fmt: skip
        if progress is not None:
            progress(done, len(names))
    return verification


def _compare_manifest(
    verification: Verification,
    results: Path,
    settings: Settings,
    statement: Mapping[str, Any] | None,
) -> dict[str, dict[str, str]]:
    """Episode → digests that a manifest states; what it says of results, rules and evaluator is compared."""
    if statement is None:
        return {}
    predicate = statement["predicate"]
    digests = {subject.get("digest", {}).get("sha256") for subject in statement["subject"]}
    if digest_of(results) not in digests:
        verification.differences.append(f"{results}: not the file that the manifest is about")
    if predicate["rules"].get("digest") != settings.rule_set.digest:
        verification.differences.append(
            "rules: they mean something else than those of the manifest"
        )
    evaluator = predicate["evaluator"]
    if (evaluator.get("version"), evaluator.get("code")) != (__version__, code_version()):
        verification.notes.append(
            f"judged by safestage {evaluator.get('version')}, code {str(evaluator.get('code'))[:12]}; "
            f"verified by {__version__}, code {code_version()[:12]}"
        )
    return {
        str(episode.get("id")): dict(episode.get("digest") or {})
        for episode in predicate["episodes"]
        if isinstance(episode, dict)
    }


def _verify_one(
    verification: Verification,
    name: str,
    rows: list[dict[str, Any]],
    ref: EpisodeRef | None,
    stated: Mapping[str, str] | None,
    settings: Settings,
    *,
    judge: bool,
) -> None:
    if ref is None:
        verification.missing.append(f"{name}: is not among the traces")
        return
    try:
        digests = opened(ref)
    except InputError as error:
        verification.missing.append(str(error))
        return
    verification.digests += 1
    for part, digest in (stated or {}).items():
        if digests.get(part) != digest:
            verification.differences.append(
                f"{name}: its {part} is not the one that the manifest states"
            )
    if any(row.get("trace_hash") != digests["content"] for row in rows):
        verification.differences.append(
            f"{name}: its content is not that of the results' trace_hash"
        )
    if judge:
        _judge_again(verification, name, rows, ref, settings)


def _judge_again(
    verification: Verification,
    name: str,
    rows: list[dict[str, Any]],
    ref: EpisodeRef,
    settings: Settings,
) -> None:
    result = score_episode(ref, settings.rule_set, **settings.arguments())
    if isinstance(result, Problem):
        verification.missing.append(result.message)
        return
    verification.judged += 1
    again = {str(row["rule"]): row for row in result.rows()}
    before = {str(row.get("rule")): row for row in rows}
    for rule in sorted(again.keys() ^ before.keys()):
        place = "the results" if rule in before else "judging again"
        verification.differences.append(f"{name}: {rule} has a verdict in {place} alone")
    if len(before) != len(rows):
        verification.differences.append(f"{name}: a rule has several rows")
    for rule in sorted(again.keys() & before.keys()):
        for column in COMPARED:
            if column not in before[rule]:
                continue
            old, new = _plain(before[rule][column]), _plain(again[rule][column])
            if old != new:
                verification.differences.append(
                    f"{name}: {rule}: {column} is {new!r}, results say {old!r}"
                )


def _plain(value: Any) -> Any:
    """A value as any format keeps it: numbers as float, nothing for what is not finite."""
    if isinstance(value, str):
        return _TRUE.get(value.lower(), value or None)
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int | float):
        number = float(value)
        return number if abs(number) < float("inf") else None
    return value
