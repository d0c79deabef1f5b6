"""Results as annotations of GitHub Actions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from safestage_eval.run.scores import Scores

from .golden import Change
from .render_github import github_line


def pieces(scores: Scores, changes: Sequence[Change] | None = None) -> Iterator[str]:
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
