"""Commands that run in processes of which every opened file and every use of the network is noted."""

from __future__ import annotations

import ctypes
import json
import os
import struct
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]
WATCH = HERE / "watch"

COMMANDS = """
import json, os, sys
from safestage_eval.cli import main

if __name__ == "__main__":
    codes = []
    for words in json.load(open(sys.argv[1])):
        with open(os.environ["SAFESTAGE_WATCHED"], "a") as log:
            log.write(f"command\\t{words[0]}\\n")
        sys.argv = ["safestage", *words]
        try:
            main()
            codes.append(0)
        except SystemExit as end:
            codes.append(end.code)
        sys.stdout.flush()
    print()
    print(json.dumps(codes))
"""

OF_PYTHON = tuple(
    Path(path).resolve()
    for path in (
        sys.prefix,
        sys.base_prefix,
        sysconfig.get_path("stdlib"),
        "/usr/lib",
        "/usr/share/zoneinfo",
        "/etc/localtime",
        "/proc",
        "/sys",
        "/dev/null",
        "/dev/urandom",
        "/dev/shm",
    )
)
"""Where Python and its libraries have their own files, and the system says what it is."""


class Seen(NamedTuple):
    """Events of commands.

    Attributes:
        codes: their exit codes.
        said: all of stdout and stderr.
        events: (kind, what) of each event; ``command`` where the next one begins.
    """

    codes: list[int]
    said: str
    events: list[tuple[str, str]]

    def of(self, *kinds: str) -> set[str]:
        """Subjects of events of some kinds."""
        return {what for kind, what in self.events if kind in kinds}

    def commands_with(self, kind: str) -> set[str]:
        """The commands in which there was such an event."""
        found, command = set(), ""
        for one, what in self.events:
            command = what if one == "command" else command
            if one == kind:
                found.add(command)
        return found

    def outside(self, kind: str, *folders: Path) -> set[str]:
        """Files that were opened elsewhere than in the folders."""
        roots = [folder.resolve() for folder in folders]
        return {
            path for path in self.of(kind) if not any(Path(path).is_relative_to(r) for r in roots)
        }


def seen(commands: Sequence[Sequence[object]], work: Path) -> Seen:
    """Run ``safestage`` with each list of words, one after the other in one process."""
    work.mkdir()
    script, todo, log = work / "commands.py", work / "commands.json", work / "events"
    script.write_text(COMMANDS)
    todo.write_text(json.dumps([[str(word) for word in words] for words in commands]))
    path = os.pathsep.join([str(WATCH), str(CHECKOUT)])
    home = {"HOME": str(work), "TMPDIR": str(work), "COLUMNS": "120"}
    environment = {**os.environ, **home, "PYTHONPATH": path, "SAFESTAGE_WATCHED": str(log)}
    run = subprocess.run(
        [sys.executable, script, todo],
        env=environment,
        cwd=work,
        capture_output=True,
        check=False,
        timeout=300,
    )
    said = (run.stdout + run.stderr).decode("utf-8", "replace")
    assert run.returncode == 0, said
    codes = json.loads(run.stdout.splitlines()[-1])
    lines = log.read_text("utf-8").splitlines()
    return Seen(codes, said, [tuple(line.split("\t", 1)) for line in lines])  # type: ignore[misc]


OPENED = 0x20 | 0x1 | 0x2
"""``IN_OPEN``, ``IN_ACCESS`` and ``IN_MODIFY`` of inotify(7)."""


@contextmanager
def looked_into(*places: Path) -> Iterator[list[str]]:
    """Names of what is opened in or as the places, by whatever process and library. Linux only."""
    libc = ctypes.CDLL(None, use_errno=True)
    number = libc.inotify_init1(os.O_NONBLOCK)
    assert number >= 0
    found: list[str] = []
    try:
        for place in places:
            assert libc.inotify_add_watch(number, os.fsencode(place), OPENED) > 0
        yield found
        while True:
            try:
                data = os.read(number, 1 << 16)
            except BlockingIOError:
                break
            at = 0
            while at < len(data):
                _, mask, _, size = struct.unpack_from("iIII", data, at)
                name = data[at + 16 : at + 16 + size].rstrip(b"\0").decode()
                if not mask & 0x40000000:  # of the folder itself: it was listed
                    found.append(name or "the file")
                at += 16 + size
    finally:
        os.close(number)
