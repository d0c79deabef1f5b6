"""The run browser's server: this machine alone, one page, and the pieces of one run."""

from __future__ import annotations

import re
import threading
from http import HTTPStatus
from urllib.parse import SplitResult

from safestage_eval._serving.guard import Guard
from safestage_eval._serving.guarded_http import GuardedHandler, GuardedServer, Refused

from .browser_page import SCRIPTS
from .html_page import LIBRARIES, part
from .live_run import LiveRun

SCRIPT = "text/javascript; charset=utf-8"


class RunServer(GuardedServer):
    """Serves one run, and judges it meanwhile."""

    def __init__(
        self, run: LiveRun, port: int = 0, names: tuple[str, ...] = (), *, judging: bool = True
    ) -> None:
        """Bind to a port, and judge what is left of the run meanwhile.

        Args:
            run: to be served.
            port: 0 is any that is free.
            names: host names by which browsers reach it, besides those of the loopback interface.
            judging: False: judge no episodes in the background.

        Raises:
            InputError: the port is taken.
        """
        self.run = run
        super().__init__(_Handler, Guard(names), port)
        if judging and run.left:
            threading.Thread(target=run.judge_all, daemon=True).start()


class _Handler(GuardedHandler):
    server: RunServer

    def get(self, url: SplitResult) -> None:
        """Send the page, a library, a piece or a film."""
        run, path = self.server.run, url.path
        if path == "/":
            self.send(run.page(), "text/html; charset=utf-8")
        elif path in {f"/lib/{name}" for name in SCRIPTS}:
            self.send(part(path.removeprefix("/lib/"), LIBRARIES).encode(), SCRIPT)
        elif match := re.fullmatch(r"/data/(run|e\d{1,9}|m[0-9a-f]{1,64})\.js", path):
            try:
                self.send(run.piece(match[1]), SCRIPT)
            except KeyError:
                raise Refused(HTTPStatus.NOT_FOUND, "no such piece") from None
        elif (match := re.fullmatch(r"/films/(\d{1,9})", path)) and int(match[1]) < len(run.refs):
            self.send_film(run.film(int(match[1])))
        else:
            raise Refused(HTTPStatus.NOT_FOUND, "no such page")
