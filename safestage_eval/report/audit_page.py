"""docs/audit.md: every check of the audit, written from the declarations.

``python -m safestage_eval.report.audit_page docs/audit.md`` rewrites it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from safestage_eval.audit import Check, choose
from safestage_eval.doubts.check_registry import KINDS

INTRODUCTION = """\
# Is my evaluation sound?

<!-- Written by `make audit-docs` from the checks; changes belong there. -->

```
safestage audit traces/                        everything below
safestage audit traces/ --rules mine.toml      with your own rules
safestage audit traces/ --fail-on warning      exit code 1 for warnings as well
safestage audit --explain AUD104               one check
```

`safestage audit` reads stored rollouts and lists what would make their verdicts wrong or meaningless. Each finding has
a code, a place (episode, body, field, time), a likely cause and a fix.

| severity | means |
|---|---|
| error | verdicts would be wrong or missing |
| warning | some verdicts are unreliable |
| note | worth knowing |

A defect is reported once; what follows from it is left out (contacts off every surface, where lengths are in
centimetres). *Not beside* names the checks that already explain a defect. `--select` and `--ignore` choose checks by
code or prefix (`AUD1`). If lengths, masses and gravity are all in other units, a recording shows no sign of it, and the
audit does not find it.
"""

HEADINGS = {
    "recording": "Of a recording",
    "scene": "Of a scene",
    "evaluation": "Of an evaluation",
}


def page() -> str:
    """The whole page."""
    parts = [INTRODUCTION]
    for kind, _ in KINDS.values():
        checks = [one for one in choose() if one.of == kind]
        if checks:
            parts.append("\n".join([f"\n## {HEADINGS[kind]}", *(_section(one) for one in checks)]))
    return "".join(parts)


def _section(check: Check) -> str:
    return "\n".join(_lines(check))


def _lines(check: Check) -> Iterator[str]:
    yield f"\n### {check.code}: {check.title}\n"
    seen = f" Seen in {link(check.issue)}." if check.issue else ""
    yield f"*{check.severity}.* {check.why}{seen}\n"
    yield f"- **Check**: {check.how}"
    yield f"- **Example**: {check.example}"
    if check.unless:
        yield f"- **Not beside** {', '.join(check.unless)}"
    yield ""


def link(issue: str) -> str:
    """``owner/name#12`` as a link to the thread."""
    repository, _, number = issue.partition("#")
    return f"[{issue}](https://github.com/{repository}/issues/{number})"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
