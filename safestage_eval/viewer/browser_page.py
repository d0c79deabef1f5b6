"""The page of the run browser: the shell, and what it carries."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from html import escape
from typing import Any, Literal

from safestage_eval.palette import HATCHINGS, SIGNS

from .html_page import LIBRARIES, THEME_SWITCH, page, part, script_hash
from .module_links import linked
from .packed import block, columns, compact, packed

Carried = Literal["file", "folder", "live"]
"""Where the pieces are: in the page, in files beside it, or with a server that makes them."""

SCRIPTS = ("three.min.js", "uplot.min.js")
"""Libraries that are loaded when the first episode is opened."""


def run_data(title: str, tables: Mapping[str, Mapping[str, list[Any]]], **more: Any) -> str:
    """The list of a run as JSON: columns of episodes and findings, and further facts about it."""
    packed_tables = {name: columns(table) for name, table in tables.items()}
    return compact({"title": title, **packed_tables, **more})


def browser_page(
    title: str,
    results: Iterable[str],
    carried: Carried,
    pieces: Mapping[str, str] | None = None,
) -> str:
    """Build the page.

    Args:
        title: of the run, as plain text.
        results: HTML of ``overview``; nothing where there are none yet.
        carried: where the pieces are.
        pieces: name → packed content, for a page that carries them: the list of the run is ``run``.
    """
    results = list(results)
    shell = part("browser.html", "safestage_eval.viewer.browser")
    before, after = shell.split("{results}")
    body = [
        before.replace("{title}", escape(title)).replace("{theme}", THEME_SWITCH),
        *results,
        after,
    ]
    if pieces:
        body += [block(name, data) for name, data in pieces.items()]
    allow = {"img-src": "data: blob:"}
    hashes: list[str] = []
    if carried == "file":
        body += [block(f"lib-{name}", data) for name, data in _libraries().items()]
        hashes = [script_hash(part(name, LIBRARIES)) for name in SCRIPTS]
    else:
        local = "'self' file:" if carried == "folder" else "'self'"
        hashes = [local]
        allow["media-src"] = local
    sheets = [
        part("uplot.min.css", LIBRARIES), part("hatchings.css"), part("results.css"),
        *(part(f"{name}.css", "safestage_eval.viewer.browser") for name in ("layout", "episode", "appendix")),
    ]  # fmt: skip
    return page(
        title,
        body,
        styles=sheets,
        scripts=[linked("main.js")],
        allow=allow,
        more_scripts=hashes,
        data={
            "carried": carried,
            "hatchings": json.dumps(HATCHINGS),
            "signs": json.dumps(SIGNS, ensure_ascii=False),
            "results": "yes" if results else "",
        },
    )


@cache
def _libraries() -> dict[str, str]:
    return {name.split(".", maxsplit=1)[0]: packed(part(name, LIBRARIES)) for name in SCRIPTS}
