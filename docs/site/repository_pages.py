"""Pages written from files outside docs/, and the rewriting of links that lead out of it."""

from __future__ import annotations

import re
from pathlib import Path

LINK = re.compile(r"(!?)\[([^\]]*)\]\(((?:\.\./)*)([^)\s:#]+)(#[^)\s]*)?\)")

VERSIONS = """\
# Versions

`safestage --version` prints the version of SafeStage. What it reads and writes is versioned apart:

| format | version | changes when |
|---|---|---|
| a trace | `schema_version` of its header, `major.minor` | a minor version only adds optional fields; a newer major version is refused. Traces of every older version stay readable |
| a rule file | `format = 1` under `[ruleset]` | the language changes; a file of another format is refused (`R103`) |
| a rule | its digest, in every result row | anything changes that its verdict follows from; not with prose or spelling |
| a result | `version`, `rule_digest` and `trace_hash` of each row | evaluator, rule or trace changes |

"""


def versions_page(changelog: Path) -> str:
    """The page of versions: those of formats and rules, then the changelog."""
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
    """Links for readers of the site, not of the repository.

    A link that names the file of another page names its title instead. One that leads out of docs/ becomes the
    path in the repository, as code; to what is not there it stays as it is, so that the build fails.
    """

    def rewritten(found: re.Match[str]) -> str:
        bang, text, up, path, anchor = found.groups()
        target = ((docs / page).parent / up / path).resolve()
        if bang or not target.exists():
            return found[0]
        if target.is_relative_to(docs):
            named = text.endswith(".md") and target.suffix == ".md"
            return f"[{_title(target)}]({up}{path}{anchor or ''})" if named else found[0]
        shown = target.relative_to(docs.parent).as_posix()
        return f"`{shown}`" if text.strip("`") in shown else f"{text} (`{shown}`)"

    return LINK.sub(rewritten, markdown)


def _title(page: Path) -> str:
    """The first heading of a page, without its markup."""
    (heading,) = re.findall(r"\A# (.+)", page.read_text("utf-8"))
    return str(heading).replace("`", "")
