"""MkDocs hooks: add the pages that are generated from code, and keep links inside the site."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))

from benchmark_page import benchmark_page
from command_pages import commands_page
from message_page import messages_page
from notebook_pages import notebook_page
from python_page import python_page
from repository_pages import keep_inside, versions_page
from site_style import style_sheet
from skill_page import skills_page

DOCS = Path(__file__).resolve().parents[1]

WRITTEN: dict[str, Callable[[], str]] = {
    "reference/benchmark_rules.md": benchmark_page,
    "reference/commands.md": commands_page,
    "reference/messages.md": lambda: messages_page(DOCS),
    "reference/python.md": python_page,
    "reference/skills.md": skills_page,
    "reference/versions.md": lambda: versions_page(DOCS.parent / "CHANGELOG.md"),
    "site.css": style_sheet,
}
"""Path on the site → function that generates it."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages and the notebooks."""
    for path, write in WRITTEN.items():
        files.append(File.generated(config, path, content=write()))
    for notebook in sorted((DOCS / "notebooks").glob("*.ipynb")):
        path = f"notebooks/{notebook.stem}.md"
        files.append(File.generated(config, path, content=notebook_page(notebook)))
    return files


CODE = re.compile(r"(<pre.*?</pre>)|<code>([^<]*)</code>", re.DOTALL)
HYPHENATED = re.compile(r"[^\s=,/]*\w?-[^\s=,/]*")
LONGEST = 30
"""Characters of a word that is kept in one line; longer ones would not fit beside others on a telephone."""


def on_page_content(html: str, **_: object) -> str:
    """Keep options and ids in one line where they have hyphens: ``--golden``, not ``--`` and ``golden``."""

    def whole(found: re.Match[str]) -> str:
        word = found[0]
        return f'<span class="whole">{word}</span>' if len(word) <= LONGEST else word

    return CODE.sub(
        lambda found: found[1] or f"<code>{HYPHENATED.sub(whole, found[2])}</code>", html
    )


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Keep links inside the site."""
    return keep_inside(markdown, page.file.src_uri, DOCS)
