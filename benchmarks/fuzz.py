"""The campaign: many hostile inputs of each format, in a process that may die, hang or swell.

    python benchmarks/fuzz.py                        # 10,000 inputs of every format
    python benchmarks/fuzz.py mcap --inputs 500      # of one format
    python benchmarks/fuzz.py mcap --only 1234       # one input again, which is left in --folder
    python benchmarks/fuzz.py mcap --write docs/security.md  # its row into the page's table

Each input follows from the format's name and its number alone. ``--write`` puts a format's row in when it is
done, in the place of its row of an earlier run; the other rows stay.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / place) for place in ("tests/fuzz", "tests/helpers", ".")]

from outcome import BAD  # noqa: E402
from targets import TARGETS, attempt  # noqa: E402

TIMEOUT = 20.0
"""s of processor time that an input may take; a busy machine makes no hang of it."""

ASLEEP = 300.0
"""s after which an input hangs however little of the processor it took: it waits for something."""

STOPPED = threading.Event()
"""Set by SIGTERM: the rows are written of what was tried until then."""

MEMORY = 6 << 30
"""Bytes of address space of the process: what it reserves, of which it uses far less."""


def worker(key: str, first: int, last: int, folder: Path) -> None:
    """Inputs one after the other; a line about each on stdout, and nothing else."""
    tell, sys.stdout = sys.stdout, sys.stderr
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    target = TARGETS[key](folder)
    for number in range(first, last):
        print(json.dumps([number]), file=tell, flush=True)
        began = time.process_time()
        kind, what, said = attempt(target, number)
        used = time.process_time() - began
        print(json.dumps([number, kind, what, said[:2000], used]), file=tell, flush=True)


@dataclass
class Tally:
    """What a campaign of one format came to."""

    counts: Counter[str] = field(default_factory=Counter)
    found: list[tuple[int, str, str, str]] = field(default_factory=list)
    seconds: float = 0.0

    def note(self, number: int, kind: str, what: str, said: str, used: float = 0.0) -> None:
        """One input, and s of the processor that it took."""
        self.counts[kind] += 1
        self.seconds += used
        if kind not in BAD and kind not in ("crash", "hang"):
            return
        self.found.append((number, kind, what, said))
        print(f"{number} {kind}: {what}: {said}", file=sys.stderr, flush=True)

    def add(self, other: Tally) -> None:
        """What another came to."""
        self.counts += other.counts
        self.found += other.found
        self.seconds += other.seconds


def campaign(
    key: str, inputs: int, folder: Path, first: int, jobs: int, seconds: float = math.inf
) -> Tally:
    """All inputs of a format, or as many as fit into s of the processor, shared out among processes."""
    edges = [first + inputs * job // jobs for job in range(jobs + 1)]
    whole = Tally()
    with ThreadPoolExecutor(jobs) as pool:
        parts = [
            pool.submit(stretch, key, end - begin, folder / str(begin), begin, seconds / jobs)
            for begin, end in pairwise(edges)
            if end > begin
        ]
        for part in parts:
            whole.add(part.result())
    return whole


def stretch(key: str, inputs: int, folder: Path, first: int, seconds: float) -> Tally:
    """Inputs one after the other; the process is begun anew after each that kills it."""
    tally, at, last = Tally(), first, first + inputs
    while at < last and tally.seconds < seconds and not STOPPED.is_set():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        command = [sys.executable, __file__, key, "--worker", str(at), str(last)]
        log = (folder / "stderr").open("wb")
        child = subprocess.Popen(
            [*command, "--folder", str(folder)], stdout=subprocess.PIPE, stderr=log
        )
        under_way, began, used = None, time.monotonic(), 0.0
        try:
            buffer = b""
            while tally.seconds < seconds and not STOPPED.is_set():
                ready, _, _ = select.select([child.stdout], [], [], 1.0)
                if not ready:
                    waited = time.monotonic() - began
                    if under_way is None:
                        if waited > 2 * ASLEEP:
                            raise RuntimeError(f"{key}: the process does not come up")
                        continue
                    if waited < ASLEEP and processor_time(child.pid) - used < TIMEOUT:
                        continue
                    child.kill()
                    tally.note(under_way, "hang", "", f"{waited:.0f} s")
                    at = under_way + 1
                    break
                part = child.stdout.read1()
                if not part:
                    child.wait()
                    if under_way is not None:
                        tally.note(under_way, "crash", "", f"exit {child.returncode}")
                        at = under_way + 1
                    elif at < last:
                        raise RuntimeError(f"{key}: the process ended with {child.returncode}")
                    break
                buffer += part
                *lines, buffer = buffer.split(b"\n")
                for line in lines:
                    told = json.loads(line)
                    began, used = time.monotonic(), processor_time(child.pid)
                    if len(told) == 1:
                        under_way = told[0]
                    else:
                        tally.note(*told)
                        under_way, at = None, told[0] + 1
        finally:
            child.kill()
            child.wait()
            child.stdout.close()
    return tally


def memory_folder() -> str | None:
    """A folder that is no disk, where there is one."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def processor_time(process: int) -> float:
    """S that a process has computed so far."""
    told = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


HEAD = (
    "format", "inputs", "same verdicts", "inconclusive", "listed problem", "read",
    "unforeseen error", "other verdict", "false pass", "crash", "hang", "ms each", "with",
)  # fmt: skip

KINDS = (
    "same", "unknown", "problem", "read", "unforeseen", "changed", "false pass", "crash", "hang",
)  # fmt: skip

MARKS = ("<!-- fuzz table -->", "<!-- end of the fuzz table -->")
"""Around the table in a page."""


def row(key: str, tally: Tally) -> str:
    """The outcomes of one format as a row of Markdown."""
    inputs = tally.counts.total()
    cells = [TARGETS[key].name, f"{inputs:,}", *(f"{tally.counts[kind]:,}" for kind in KINDS)]
    read_by = ", ".join(f"{name} {version(name)}" for name in TARGETS[key].read_by)
    cells += [f"{1e3 * tally.seconds / max(inputs, 1):.1f}", read_by]
    return "| " + " | ".join(cells) + " |"


def table(rows: Iterable[str]) -> str:
    """Rows under their heads, in the order of the formats."""
    order = {target.name: place for place, target in enumerate(TARGETS.values())}
    known = [line for line in rows if _named(line) in order]
    known.sort(key=lambda line: order[_named(line)])
    return "\n".join(["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|", *known])


def write(page: Path, line: str) -> None:
    """A format's row into the table of a page, in the place of an earlier one of this format."""
    before, inside, after = re.split("|".join(map(re.escape, MARKS)), page.read_text("utf-8"))
    rows = {_named(old): old for old in inside.strip().splitlines() if old.startswith("| ")}
    rows[_named(line)] = line
    ran = (
        f"Python {platform.python_version()} on {platform.system()} {platform.machine()}; "
        f'"ms each" is processor time.'
    )
    text = f"{before}{MARKS[0]}\n{table(rows.values())}\n\n{ran}\n{MARKS[1]}{after}"
    page.write_text(text, "utf-8")


def _named(line: str) -> str:
    return line.split("|")[1].strip()


def main() -> int:
    """Run what the command line asks for; 1 when something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("formats", nargs="*", help=f"of {', '.join(TARGETS)}; all if none")
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--seconds", type=float, default=math.inf, help="of the processor for each format, at most"
    )
    parser.add_argument("--write", type=Path, help="a page with the table's marks")
    parser.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path)
    asked = parser.parse_args()
    formats = asked.formats or list(TARGETS)
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="fuzz", dir=memory_folder()))
    if asked.worker:
        worker(formats[0], *asked.worker, folder)
        return 0
    if asked.only is not None:
        folder.mkdir(parents=True, exist_ok=True)
        print(attempt(TARGETS[formats[0]](folder), asked.only))
        print(folder)
        return 0
    signal.signal(signal.SIGTERM, lambda *_: STOPPED.set())
    rows, found = [], 0
    for key in formats:
        began = time.monotonic()
        tally = campaign(key, asked.inputs, folder / key, asked.first, asked.jobs, asked.seconds)
        took = f"{time.monotonic() - began:.0f} s, of the processor {tally.seconds:.0f} s"
        print(f"{key}: {dict(tally.counts)} in {took}", file=sys.stderr)
        found += len(tally.found)
        rows.append(row(key, tally))
        if asked.write is not None and tally.counts:
            write(asked.write, rows[-1])
    print(table(rows))
    if asked.folder is None:
        shutil.rmtree(folder, ignore_errors=True)
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
