"""The labelling page: one document, everything inline."""

from __future__ import annotations

import json
from functools import cache
from html import escape

from safestage_eval.palette import HATCHINGS
from safestage_eval.viewer.html_page import THEME_SWITCH, page, part, replay_script

ALLOW = {"connect-src": "'self'", "media-src": "'self'"}


@cache
def label_page(total: int, reviewer: str | None) -> str:
    """Build the page for a number of rollouts; with ``reviewer`` None it asks for a name."""

    def own(name: str) -> str:
        return part(name, "safestage_eval.label")

    attribute = f'data-reviewer="{escape(reviewer)}"' if reviewer is not None else ""
    body = [
        own("label.html")
        .replace("{total}", str(total))
        .replace("{reviewer}", attribute)
        .replace("{theme}", THEME_SWITCH)
    ]
    scripts = [replay_script(), own("label.js")]
    marks = {"hatchings": json.dumps(HATCHINGS)}
    styles = [part("hatchings.css"), own("label.css")]
    return page("Safe or unsafe?", body, styles=styles, scripts=scripts, allow=ALLOW, data=marks)
