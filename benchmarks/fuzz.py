"""The campaign: many hostile inputs of each format, each held against the undamaged one.

    python benchmarks/fuzz.py                        # of every format 200 inputs of today
    python benchmarks/fuzz.py mcap --inputs 500      # of one format
    python benchmarks/fuzz.py mcap --seed 739000 --only 1234 --keep found   # one input again
    python benchmarks/fuzz.py --seed 1 --inputs 20000 --jobs 16 --write docs/security.md

An input follows from the seed, the format's name and its number alone; without ``--seed`` the seed is the day,
and is printed. ``--write`` puts the rows of formats of which as many inputs were tried as before into the page's
table. Exit code 1: something was found.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / place) for place in ("tests/fuzz", "tests/helpers", "recorder", ".")]

from outcome import BAD  # noqa: E402
from targets import TARGETS, attempt  # noqa: E402

TIMEOUT, ASLEEP = 10.0, 300.0
"""s of processor time that an input may take, as a busy machine makes no hang of it; and s in all."""
SWOLLEN, SPACE = 1 << 30, 6 << 30
"""Bytes of memory that an input may take, and of address space of its process."""
BATCH = 40
"""Inputs of a process, which is forked from one that has everything loaded."""
WRONG = (*BAD, "crash", "hang")


@dataclass
class Tally:
    """Outcomes of the inputs of one format, and the processor time that they took (s)."""

    counts: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0


@dataclass
class Batch:
    """Inputs one after the other in a process of their own."""

    process: Any
    last: int
    place: Path
    at: int
    began: float = field(default_factory=time.monotonic)
    used: float = 0.0

    def hangs(self) -> bool:
        """Whether the input under way takes too long."""
        waited = time.monotonic() - self.began
        busy = waited > TIMEOUT and processor_time(self.process.pid) - self.used > TIMEOUT
        return waited > ASLEEP or busy


def work(target: Any, numbers: range, seed: int, place: Path, pipe: Connection) -> None:
    """Try inputs in this process; before and after each, a word about it."""
    resource.setrlimit(resource.RLIMIT_AS, (SPACE, SPACE))
    with (place / "stderr").open("wb") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    target.folder = place
    for number in numbers:
        pipe.send((number,))
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory is counted from now on
        before, began = memory("VmRSS"), time.process_time()
        kind, what, said = attempt(target, number, seed)
        used, took = time.process_time() - began, memory("VmHWM") - before
        if kind not in BAD and took > SWOLLEN:
            kind, said = "swollen", f"{took >> 20} MiB; {said}"
        if kind not in BAD and used > TIMEOUT:
            kind, said = "hang", f"{used:.1f} s; {said}"
        pipe.send((number, kind, what[:500], said[:2000], used))
        if kind in WRONG:
            pipe.recv()  # until the input is kept


def memory(what: str) -> int:
    """Bytes, of a line of /proc/self/status."""
    text = Path("/proc/self/status").read_text()
    return int(text.partition(f"{what}:")[2].split()[0]) << 10


def processor_time(process: int) -> float:
    """S that a process has computed so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def campaign(key: str, asked: argparse.Namespace, folder: Path) -> Tally:
    """All inputs of a format."""
    (folder / "seeds").mkdir(parents=True)
    target, tally, fork = TARGETS[key](folder / "seeds"), Tally(), get_context("fork")
    waiting = [(n, min(n + BATCH, asked.inputs)) for n in range(0, asked.inputs, BATCH)]
    running: dict[Any, Batch] = {}

    def note(batch: Batch, number: int, kind: str, what: str, said: str, used: float) -> None:
        tally.counts[kind] += 1
        tally.seconds += used
        batch.at = number + 1
        if kind in WRONG:
            print(f"{key} {number} {kind}: {what}: {said}", file=sys.stderr, flush=True)
            keep(key, batch.place, number, asked, f"{kind}: {what}\n{said}\n")

    def ended(pipe: Any) -> None:
        batch = running.pop(pipe)
        batch.process.join()
        shutil.rmtree(batch.place, ignore_errors=True)
        if batch.at < batch.last:
            waiting.insert(0, (batch.at, batch.last))

    while waiting or running:
        while waiting and len(running) < asked.jobs:
            (first, last), (pipe, theirs) = waiting.pop(0), fork.Pipe()
            place = Path(tempfile.mkdtemp(dir=folder))
            words = (target, range(first, last), asked.seed, place, theirs)
            process = fork.Process(target=work, args=words)
            process.start()
            theirs.close()
            running[pipe] = Batch(process, last, place, first)
        for pipe in wait(list(running), 1.0):
            batch = running[pipe]
            try:
                report = pipe.recv()
            except EOFError:
                batch.process.join()
                if batch.at < batch.last:
                    note(batch, batch.at, "crash", "", f"exit {batch.process.exitcode}", 0.0)
                ended(pipe)
                continue
            if len(report) == 1:
                batch.began, batch.used = time.monotonic(), processor_time(batch.process.pid)
            else:
                note(batch, *report)
                if report[1] in WRONG:
                    pipe.send("kept")
        for pipe, batch in list(running.items()):
            if batch.hangs():
                batch.process.kill()
                note(batch, batch.at, "hang", "", f"{ASLEEP:.0f} s, or busy for too long", TIMEOUT)
                ended(pipe)
    return tally


def keep(key: str, place: Path, number: int, asked: argparse.Namespace, said: str) -> None:
    """Keep an input that something was found in, with the words that make it again."""
    if asked.keep is None:
        return
    folder = asked.keep / f"{key}-{asked.seed}-{number}"
    folder.mkdir(parents=True, exist_ok=True)
    again = f"python benchmarks/fuzz.py {key} --seed {asked.seed} --only {number}"
    (folder / "told.txt").write_text(f"{again}\n{said}", "utf-8")
    for made in place.glob("input*"):
        copy = shutil.copytree if made.is_dir() else shutil.copy
        copy(made, folder / made.name)


HEAD = (
    "format", "inputs", "same verdicts", "less sure", "listed problem", "lies",
    "unforeseen error", "other verdict", "false pass", "crash", "hang", "swollen", "ms each", "seed", "with",
)  # fmt: skip
KINDS = (
    "same", "unknown", "problem", "lie", "unforeseen", "changed", "false pass", "crash", "hang",
    "swollen",
)  # fmt: skip
MARKS = ("<!-- fuzz table -->", "<!-- end of the fuzz table -->")
"""Around the table in a page."""


def row(key: str, tally: Tally, seed: int) -> tuple[str, ...]:
    """The outcomes of one format, a cell for each of ``HEAD``."""
    inputs = tally.counts.total()
    used = [f"{name} {version(name)}" for name in TARGETS[key].read_by]
    return (
        TARGETS[key].name, f"{inputs:,}", *(f"{tally.counts[kind]:,}" for kind in KINDS),
        f"{1e3 * tally.seconds / max(inputs, 1):.1f}", str(seed),
        ", ".join([f"Python {platform.python_version()}", *used]),
    )  # fmt: skip


def table(rows: list[tuple[str, ...]]) -> str:
    """Rows under their heads."""
    lines = [HEAD, ("---",) * len(HEAD), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def write(page: Path, new: list[tuple[str, ...]]) -> None:
    """The table of a page anew; a row of more inputs stays."""
    before, inside, after = re.split("|".join(map(re.escape, MARKS)), page.read_text("utf-8"))
    lines = [line for line in inside.splitlines() if line.startswith("|")][2:]
    rows = [tuple(cell.strip() for cell in line.split("|")[1:-1]) for line in lines]
    for one in new:
        tried = int(one[1].replace(",", ""))
        alike = [old for old in rows if old[0] == one[0]]
        if all(int(old[1].replace(",", "")) <= tried for old in alike):
            rows = [old for old in rows if old not in alike] + [one]
    order = [target.name for target in TARGETS.values()]
    rows.sort(key=lambda cells: order.index(cells[0]))
    ran = f'{platform.system()} {platform.machine()}; "ms each" is processor time.'
    page.write_text(f"{before}{MARKS[0]}\n{table(rows)}\n\n{ran}\n{MARKS[1]}{after}", "utf-8")


def main() -> int:
    """Run what the command line asks for; 1 when something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("formats", nargs="*", help=f"of {', '.join(TARGETS)}; all if none")
    parser.add_argument("--inputs", type=int, default=200, help="of each format")
    parser.add_argument("--seed", type=int, default=datetime.now(UTC).toordinal())
    parser.add_argument("--only", type=int, help="one input again")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--keep", type=Path, help="folder for inputs in which something is found")
    parser.add_argument("--write", type=Path, help="a page with the table's marks")
    asked = parser.parse_args()
    print(f"seed {asked.seed}", file=sys.stderr)
    memory_disk = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    rows, found = [], False
    with tempfile.TemporaryDirectory(prefix="fuzz", dir=memory_disk) as name:
        for key in asked.formats or list(TARGETS):
            folder = Path(name) / key
            if asked.only is not None:
                folder.mkdir()
                outcome = attempt(TARGETS[key](folder), asked.only, asked.seed)
                print(outcome)
                keep(key, folder, asked.only, asked, str(outcome))
                return int(outcome.bad)
            tally = campaign(key, asked, folder)
            rows.append(row(key, tally, asked.seed))
            found |= any(tally.counts[kind] for kind in WRONG)
            print(f"{key}: {dict(tally.counts)}", file=sys.stderr, flush=True)
            shutil.rmtree(folder)
    print(table(rows))
    if asked.write is not None:
        write(asked.write, rows)
    return int(found)


if __name__ == "__main__":
    sys.exit(main())
