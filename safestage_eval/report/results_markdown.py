"""Results as Markdown: the rates, how each rule fared, then one bullet per finding."""

from __future__ import annotations

from safestage_eval.metrics import by_policy_stage, outcomes, rates
from safestage_eval.run.scores import Scores

from .render_markdown import markdown_code, markdown_lines, markdown_list, markdown_text
from .results_text import COLUMNS, by_importance, left_out, set_aside_lines, why_open
from .summary import headline, rate_table, summary
from .table import Table


def render(scores: Scores) -> str:
    """Two sections; problems as a third if there are any."""
    every = outcomes(scores.results, scores.set_aside)
    total, rules = rates(every), scores.by_rule
    first, *others = headline(total, len(scores.problems))
    lines = [f"**{first}.**  "]
    lines += [f"{line[:1].upper()}{line[1:]}.  " for line in (*others, *summary(total))]
    by_rule = Table(
        "",
        ("rule", "asks", *COLUMNS.values(), "why undecided"),
        [
            [c.rule, c.title, *(str(c[name]) for name in COLUMNS), why_open(c) if c.cause else ""]
            for c in rules
        ],
        2,
        1,
    )
    cells = rate_table(by_policy_stage(every))
    lines += ["", *markdown_lines(by_rule), "", *markdown_lines(cells), ""]
    left = [*set_aside_lines(rules), *left_out(total, scores)]
    lines += [markdown_text(f"{line}.") for line in left]
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
