"""Loaded first by every Python process with this folder on its path: notes what it opens and where it goes.

One line per event in the file that ``SAFESTAGE_WATCHED`` names: ``net``, ``run``, ``read`` or
``write``, then the address, the program, or the path without links.
"""

import os
import sys

NET = ("bind", "connect", "getaddrinfo", "gethostbyaddr", "gethostbyname", "getnameinfo", "sendto")
RUN = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "pty.spawn")
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


def watch(log):
    inside = False

    def note(kind, what):
        os.write(log, f"{kind}\t{what!s}\n".encode("utf-8", "backslashreplace"))

    def hook(event, arguments):
        nonlocal inside
        if inside:
            return
        inside = True
        try:
            if event == "open" and isinstance(arguments[0], str | bytes):
                path = os.path.realpath(os.fsdecode(arguments[0]))
                mode, flags = arguments[1] or "", arguments[2] or 0
                note("write" if set(mode) & set("wax+") or flags & WRITES else "read", path)
            elif event.startswith("socket.") and event.removeprefix("socket.") in NET:
                note("net", f"{event} {arguments[1:]}")
            elif event in RUN:
                note("run", f"{event} {arguments[0]}")
        finally:
            inside = False

    sys.addaudithook(hook)


if name := os.environ.get("SAFESTAGE_WATCHED"):
    watch(os.open(name, os.O_WRONLY | os.O_APPEND | os.O_CREAT))
