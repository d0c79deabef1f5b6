"""The index of messages by code: rule files, the audit, and verdicts."""

from __future__ import annotations

import re
from pathlib import Path

from safestage_eval.audit import choose
from safestage_eval.rules import builtin_names, load_rules

HEAD = """\
# Messages by code

| code | comes from | means that |
|---|---|---|
| `R101` … `R416` | `safestage rules check`, and every command that reads rules | [a rule file is wrong](#rule-files) |
| `AUD101` … `AUD399` | `safestage audit`, and one line of `safestage score` | [a recording, scene or evaluation is unsound](#the-audit) |
| `ISH101`, `ETS201`, … | `safestage score`, `safestage explain` | [a rule was violated, or could not be decided](#rules) |
| `0`, `1`, `2`, `130` | the exit of every command | [how it ended](../cli.md#exit-codes) |

`safestage audit --explain CODE` and `safestage rules show CODE` explain a code in the terminal. This page is
written from the declarations of checks and rules.
"""

CODE = re.compile(r"^\| `(R\d{3})` \| (.+) \|$", re.MULTILINE)


def messages_page(docs: Path) -> str:
    """All codes with their titles, each leading to its explanation."""
    diagnostics = CODE.findall((docs / "rules.md").read_text("utf-8"))
    parts = [HEAD, "## Rule files\n", "| code | problem |\n|---|---|"]
    parts.extend(
        f"| [`{code}`](../rules.md#what-the-diagnostics-mean) | {text} |"
        for code, text in diagnostics
    )
    parts.extend(["\n## The audit\n", "| code | severity | defect |\n|---|---|---|"])
    parts.extend(
        f"| [`{one.code}`](../audit.md#{_anchor(f'{one.code}: {one.title}')}) | {one.severity} | {one.title} |"
        for one in choose()
    )
    parts.extend(["\n## Rules\n", "| code | asks |\n|---|---|"])
    parts.extend(
        f"| [`{code}`](../catalogue.md#{code.lower()}) | {rule.title} |"
        for code, rule in load_rules(builtin_names()).rules.items()
    )
    return "\n".join(parts) + "\n"


def _anchor(heading: str) -> str:
    """The anchor of a heading, as the extension ``toc`` with lower-case slugs makes it."""
    from pymdownx.slugs import slugify

    return slugify(case="lower")(heading.replace("`", ""), "-")
