"""Self-contained HTML pages: everything inline, nothing loaded."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files

from safestage_eval.palette import custom_properties

from .module_links import linked

LIBRARIES = "safestage_eval.viewer.lib"
"""Bundled third-party files, with their licences."""

THEME_SWITCH = '<button type="button" class="quiet no-print" data-theme-switch>Theme</button>'
"""The button that ``theme.js`` listens to."""

_ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'%3E"
    "%3Cpath d='M16 2 29 8v8c0 8-6 12-13 14C9 28 3 24 3 16V8z' fill='%234a3fb0'/%3E"
    "%3Cpath d='m10 16 5 5 8-10' fill='none' stroke='white' stroke-width='3'/%3E%3C/svg%3E"
)


@cache
def part(name: str, package: str = "safestage_eval.viewer") -> str:
    """Read a style sheet or script that lies in a package."""
    return files(package).joinpath(name).read_text("utf-8")


@cache
def replay_script() -> str:
    """JavaScript that defines ``SafestageReplay``, which plays a film on a canvas (``browser/replay.js``)."""
    return part("three.min.js", LIBRARIES) + "\n" + linked("replay_global.js")


def page(
    title: str,
    body: Iterable[str],
    *,
    styles: Sequence[str] = (),
    scripts: Sequence[str] = (),
    allow: Mapping[str, str] | None = None,
    data: Mapping[str, str] | None = None,
    more_scripts: Sequence[str] = (),
) -> str:
    """Write a page that loads nothing from elsewhere; its policy forbids it.

    The Content-Security-Policy names the page's own style sheets and scripts by their hashes;
    attributes such as ``style=`` and ``onclick=`` do not work in it.

    Args:
        title: as plain text.
        body: pieces of HTML, in order.
        styles: style sheets after the palette's and the theme's.
        scripts: scripts after the theme's; they run when the body is there.
        allow: further directives, ``{"connect-src": "'self'"}`` for a page with a server.
        data: attributes ``data-NAME`` of the body, for the scripts.
        more_scripts: further sources for ``script-src``: hashes of scripts that others will add.
    """
    sheets = [custom_properties(), part("theme.css"), *styles]
    first, last = [part("theme.js")], list(scripts)
    rules = {
        "default-src": "'none'",
        "img-src": "data:",
        "style-src": " ".join(map(script_hash, sheets)),
        "script-src": " ".join([*map(script_hash, first + last), *more_scripts]),
        "base-uri": "'none'",
        "form-action": "'none'",
        **(allow or {}),
    }
    policy = "; ".join(f"{name} {value}" for name, value in rules.items())
    attributes = "".join(f' data-{k}="{escape(v)}"' for k, v in (data or {}).items())
    return "".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n',
            f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">\n',
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n',
            '<meta name="color-scheme" content="light dark">\n',
            f'<title>{escape(title)}</title>\n<link rel="icon" href="{_ICON}">\n',
            *(f"<style>{text}</style>\n" for text in sheets),
            *(f"<script>{text}</script>\n" for text in first),
            f"</head>\n<body{attributes}>\n",
            *body,
            *(f"<script>{text}</script>\n" for text in last),
            "</body>\n</html>\n",
        ]
    )


def script_hash(text: str) -> str:
    """A script or style sheet as a policy names it."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
