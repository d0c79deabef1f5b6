"""Annotations of GitHub Actions (workflow commands), of results too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from safestage_eval._text.printable import printable_lines
from safestage_eval.run.scores import Scores

from .golden import Change


def github_line(level: str, title: str, message: str) -> str:
    """A workflow command of one of the levels error, warning and notice, with its line break."""
    return f"::{level} title={_escaped(title, field=True)}::{_escaped(message)}\n"


def _escaped(text: str, *, field: bool = False) -> str:
    text = printable_lines(text)
    for raw, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(raw, code)
    return text.replace(":", "%3A").replace(",", "%2C") if field else text


def results(scores: Scores, changes: Sequence[Change] | None = None) -> Iterator[str]:
    """One annotation per finding and problem; with ``changes``, per change and problem."""
    for change in changes or ():
        title = " ".join(filter(None, (change.rule, change.episode_id)))
        yield github_line("error", title, change.what)
    for result in scores.results if changes is None else ():
        for v in scores.gates.counted(result):
            if v.verdict in ("violation", "inconclusive"):
                level = "error" if v.verdict == "violation" else "warning"
                yield github_line(level, f"{v.rule} {result.episode_id}", v.explanation)
        for rule in result.not_loaded:
            title = f"{rule} {result.episode_id}"
            yield github_line("warning", title, "it is assigned and was not loaded")
    for problem in scores.problems:
        yield github_line("error", "unreadable trace", problem.message)
