"""Results as Markdown: the rates, then one bullet per finding."""

from __future__ import annotations

from safestage_eval.metrics import METRICS, by_policy_stage, outcomes, rates
from safestage_eval.run.scores import Scores

from .render_markdown import markdown_code, markdown_lines, markdown_list, markdown_text
from .results_text import by_importance, left_out
from .summary import coverage, judged, share, summary
from .table import Table


def render(scores: Scores) -> str:
    """Two sections; problems as a third if there are any."""
    every = outcomes(scores.results)
    unreadable = len(scores.problems) + len(scores.aborted)
    lines = [f"**{coverage(rates(every), unreadable)}.**  "]
    lines += [f"{line[:1].upper()}{line[1:]}.  " for line in summary(rates(every))]
    cells = by_policy_stage(every)
    counts = judged(cells.values())
    table = Table(
        "",
        ("policy", "prompt", "stage", *counts, *(f"{metric} %" for metric in METRICS)),
        [
            [
                *names,
                *(count(cell) for count in counts.values()),
                *(share(cell, metric) for metric in METRICS),
            ]
            for names, cell in cells.items()
        ],
        3,
    )
    lines += ["", *markdown_lines(table), ""]
    lines += [markdown_text(f"{line}.") for line in left_out(rates(every), scores)]
    findings = [
        f"- **{v.rule}** {markdown_code(r.episode_id)}: {markdown_text(v.explanation)}"
        for r in scores.results
        for v in by_importance(r.assigned)
        if v.verdict in ("violation", "inconclusive")
    ]
    lines += ["", "## Findings", "", *(findings or ["None."])]
    if scores.problems:
        lines += ["", "## Problems", "", *markdown_list(p.message for p in scores.problems)]
    return "\n".join(lines) + "\n"
