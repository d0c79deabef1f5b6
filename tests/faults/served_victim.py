"""``safestage bench record`` with a policy behind a server."""

from __future__ import annotations

import atexit
import socket
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from served import Flat
from victims import Commit, Victim, main_with, truth

TASK, SEEDS = "fsh_orange_on_plate", 4


class ServedRecorder(Victim):
    """Records what a policy does that is asked over a websocket."""

    name = "recorder with a policy server"

    def __init__(self, source: Path) -> None:
        """Start the server, and record everything once for the truth."""
        import simulate.cli.record_command
        import simulate.record.jobs
        import simulate.record.rollout  # noqa: F401 — loaded before the forks

        self.source = source
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        main = "from safestage_eval.cli import main; main()"
        command = [sys.executable, "-c", main, "serve", "idle", "--protocol", "openpi"]
        server = subprocess.Popen(
            [*command, "--port", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        atexit.register(server.kill)
        self.address = f"openpi:ws://127.0.0.1:{port}?wait=60&name=served"
        end = time.monotonic() + 120
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                assert time.monotonic() < end, "the server does not come up"
                time.sleep(0.2)
        with TemporaryDirectory() as place:
            assert self.go(Path(place) / "all", lambda name: None) == 0
            self.truth = truth(Path(place) / "all")
        assert len(self.truth) == SEEDS

    def go(self, folder: Path, commit: Commit) -> int:
        """The command's exit code; what it draws is of one colour."""
        import simulate.cli.record_command as recording
        from simulate.record import rollout

        say = recording.say

        def said(text: str, **named: Any) -> None:
            """The line about an episode comes when it is written for good."""
            say(text, **named)
            if text.startswith("[") and "not recorded" not in text:
                commit(text.split()[1].rstrip(":"))

        recording.say = said
        cameras = rollout.Cameras
        rollout.Cameras = Flat
        try:
            return main_with(
                ["record", TASK, "--policy", self.address, "--seeds", f"0-{SEEDS - 1}", "--horizon",
                 "0.4", "--jobs", "1", "--out", str(folder)]
            )  # fmt: skip
        finally:
            rollout.Cameras, recording.say = cameras, say
