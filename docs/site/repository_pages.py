"""Pages made of files outside docs/, and what becomes of links that lead out of it."""

from __future__ import annotations

import re
from pathlib import Path

LINK = re.compile(r"(!?)\[([^\]]*)\]\(((?:\.\./)*)([^)\s:#]+)(#[^)\s]*)?\)")

VERSIONS = """\
# Versions

SafeStage has versions of its own (`safestage --version`), and numbers for what it writes:

| what | where it stands | when it changes |
|---|---|---|
| a trace | `schema_version` of its header, `major.minor` | a minor only adds fields that may be missing; a newer major is refused with a message. A golden file of each version stays readable |
| a rule file | `format = 1` under `[ruleset]` | a file of another format is refused (`R103`) |
| a rule | its digest, in every result row | whenever anything that its verdict follows from changes, and not when prose or spelling does |
| a result | `version`, `rule_digest` and `trace_hash` of each row | – |

"""


def versions_page(changelog: Path) -> str:
    """What carries a version, and the changelog."""
    text = changelog.read_text("utf-8")
    body = re.sub(r"^(#{2,3}) ", r"#\1 ", text.split("\n", 1)[1], flags=re.MULTILINE)
    return (
        VERSIONS
        + "## Changelog\n"
        + re.sub(r"\[([^\]]*)\]\((?!docs/|https?:)[^)]*\)", r"`\1`", body).replace(
            "](docs/", "](../"
        )
    )


def keep_inside(markdown: str, page: str, docs: Path) -> str:
    """Links that lead out of docs/ become the path in the repository, as code.

    A link to what is not there stays as it is, so that the build fails.
    """

    def rewritten(found: re.Match[str]) -> str:
        bang, text, up, path, _ = found.groups()
        target = ((docs / page).parent / up / path).resolve()
        if bang or not up or target.is_relative_to(docs) or not target.exists():
            return found[0]
        shown = target.relative_to(docs.parent).as_posix()
        return f"`{shown}`" if text.strip("`") in shown else f"{text} (`{shown}`)"

    return LINK.sub(rewritten, markdown)
