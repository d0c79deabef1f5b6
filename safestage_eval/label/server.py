"""The page's server: this machine alone, one page, and only files that a session hands out."""

from __future__ import annotations

import json
import re
import sys
from functools import cache
from html import escape
from http import HTTPStatus
from urllib.parse import SplitResult, parse_qs

from safestage_eval._serving.guard import Guard
from safestage_eval._serving.guarded_http import GuardedHandler, GuardedServer, Refused
from safestage_eval.errors import InputError
from safestage_eval.palette import HATCHINGS
from safestage_eval.viewer.html_page import THEME_SWITCH, page, part, replay_script

from .session import Session

LARGEST_BODY = 65536


class Server(GuardedServer):
    """Serves one session on the loopback interface."""

    def __init__(self, session: Session, port: int = 0, names: tuple[str, ...] = ()) -> None:
        """Bind to a port; 0 is any that is free. Raises InputError if it is taken.

        ``names``: host names by which browsers reach it, besides those of the loopback interface.
        """
        self.session = session
        super().__init__(_Handler, Guard(names, largest=LARGEST_BODY), port)


class _Handler(GuardedHandler):
    server: Server

    def not_saved(self, error: OSError) -> str:
        """Name the file, not its folder."""
        return f"{self.server.session.ledger.path.name}: {error.strerror or error}"

    def get(self, url: SplitResult) -> None:
        """Send the page, or data that it requests."""
        session = self.server.session
        if url.path == "/":
            self.send(label_page(len(session.refs), session.reviewer).encode(), "text/html; charset=utf-8")  # fmt: skip
        elif url.path == "/state":
            reviewer = parse_qs(url.query).get("reviewer", [""])[0]
            self.send_json(session.state(reviewer))
        elif match := re.fullmatch(r"/rollout/(\d{1,9})(/film|/video)?", url.path):
            number, part = int(match[1]), match[2]
            if number >= len(session.refs):
                raise Refused(HTTPStatus.NOT_FOUND, "no such rollout")
            self._send_rollout(number, part)
        else:
            raise Refused(HTTPStatus.NOT_FOUND, "no such page")

    def _send_rollout(self, number: int, part: str | None) -> None:
        session = self.server.session
        try:
            if part is None:
                self.send_json(session.item(number))
            elif part == "/film":
                more = {"Content-Encoding": "gzip"}
                self.send(session.film(number), "application/octet-stream", more=more)
            else:
                self.send_film(session.video(number))
        except InputError as error:  # its message names the file: for the terminal alone
            print(f"rollout {number + 1} cannot be shown: {error}", file=sys.stderr)  # noqa: T201
            why = f"rollout {number + 1} cannot be shown; the terminal says why"
            raise Refused(HTTPStatus.UNPROCESSABLE_ENTITY, why) from None

    def post(self, url: SplitResult) -> None:
        """Store an answer of a reviewer."""
        body = self.body()
        if url.path != "/answer":
            raise Refused(HTTPStatus.NOT_FOUND, "no such page")
        number, session = body.get("rollout"), self.server.session
        if type(number) is not int or not 0 <= number < len(session.refs):
            raise Refused(HTTPStatus.NOT_FOUND, "no such rollout")
        reviewer = str(body.get("reviewer", ""))
        session.answer(number, str(body.get("label")), reviewer, str(body.get("note", "")))
        self.send_json(session.state(reviewer))


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
