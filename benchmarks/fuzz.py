"""The campaign: many hostile inputs of each format, each held against the undamaged one.

    python benchmarks/fuzz.py                        # of every format 200 inputs of today
    python benchmarks/fuzz.py mcap --inputs 500      # of one format
    python benchmarks/fuzz.py mcap --seed 739000 --only 1234 --keep found   # one input again
    python benchmarks/fuzz.py --seed 1 --inputs 20000 --jobs 16 --counts counts.json --write docs/security.md

An input follows from the seed, the format's name and its number alone; without ``--seed`` the seed is the
day, and is printed. ``--start`` and ``--inputs`` split a campaign; with ``--counts`` what was tried is kept, is not
tried again, and ``--write`` puts it into the page's table; a row of another seed stays there until as many inputs of
its format were tried. Exit code 1: something was found.
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
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / place) for place in ("tests/fuzz", "tests/helpers", "recorder", ".")]

from outcome import BAD  # noqa: E402
from targets import TARGETS, attempt  # noqa: E402

TIMEOUT = 10.0
"""s of processor time that an input may take; a busy machine makes no hang of it."""

ASLEEP = 300.0
"""s after which an input hangs however little of the processor it took: it waits for something."""

SWOLLEN = 1 << 30
"""Bytes of memory that an input may take."""

SPACE = 6 << 30
"""Bytes of address space of the process: what it reserves, of which it uses far less."""

BATCH = 40
"""Inputs of a process, which is forked from one that has everything loaded."""

STOPPED: list[int] = []
"""Signals that came: the table is written of what was tried until then."""


@dataclass
class Tally:
    """Counts of a campaign of one format."""

    counts: Counter[str] = field(default_factory=Counter)
    found: list[list[Any]] = field(default_factory=list)
    """Number, kind, what was done and what was said, of what may not be."""
    lies: list[list[Any]] = field(default_factory=list)
    """Change four values of each: valid values under no checksum."""
    seconds: float = 0.0
    done: list[list[int]] = field(default_factory=list)
    """Seed, first number and last + 1 of each batch."""

    def note(self, number: int, kind: str, what: str, said: str, used: float = 0.0) -> None:
        """One input, and s of the processor that it took."""
        self.counts[kind] += 1
        self.seconds += used
        if kind == "lie":
            self.lies.append([number, what[:80], said[:80]])
        if kind in BAD or kind in ("crash", "hang"):
            self.found.append([number, kind, what, said])
            print(f"{number} {kind}: {what}: {said}", file=sys.stderr, flush=True)


class Batch:
    """Inputs one after the other in a process of their own."""

    def __init__(
        self, target: Any, key: str, asked: argparse.Namespace, first: int, last: int, place: Path
    ) -> None:
        """Fork."""
        self.first, self.at, self.last = first, first, last
        self.under_way: int | None = None
        self.began, self.used, self.buffer = time.monotonic(), 0.0, b""
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        self.place = place
        self.out, tell = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            os.close(self.out)
            code = 70
            try:
                with (place / "stderr").open("wb") as log:
                    os.dup2(log.fileno(), 1)
                    os.dup2(log.fileno(), 2)
                signal.signal(signal.SIGTERM, signal.SIG_IGN)  # who forked it decides
                target.folder = place
                work(target, key, asked, range(first, last), tell)
                code = 0
            finally:
                os._exit(code)
        os.close(tell)

    def told(self) -> list[list[Any]]:
        """Return new output of the process; none after its end."""
        part = os.read(self.out, 1 << 20)
        self.buffer += part
        *lines, self.buffer = self.buffer.split(b"\n")
        found = [json.loads(line) for line in lines]
        if not part:
            os.close(self.out)
            status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
            self.pid = 0
            if self.at < self.last:
                number = self.at if self.under_way is None else self.under_way
                found.append([number, "crash", "", f"exit code {status}", 0.0])
        return found

    def hangs(self) -> bool:
        """Whether the input under way takes too long."""
        waited = time.monotonic() - self.began
        if self.under_way is None:
            return waited > ASLEEP
        return waited > ASLEEP or (
            waited > TIMEOUT and processor_time(self.pid) - self.used > TIMEOUT
        )

    def kill(self) -> None:
        """End it at once."""
        if self.pid:
            os.kill(self.pid, signal.SIGKILL)


def work(target: Any, key: str, asked: argparse.Namespace, numbers: range, tell: int) -> None:
    """Try inputs; before and after each, a line about it."""
    resource.setrlimit(resource.RLIMIT_AS, (SPACE, SPACE))

    def say(*what: Any) -> None:
        os.write(tell, (json.dumps(what) + "\n").encode())

    for number in numbers:
        say(number)
        forget_peak()
        before, began = memory("VmRSS"), time.process_time()
        kind, what, said = attempt(target, number, asked.seed)
        used, took = time.process_time() - began, memory("VmHWM") - before
        if kind not in BAD and took > SWOLLEN:
            kind, said = "swollen", f"{took >> 20} MiB; {said}"
        if kind not in BAD and used > TIMEOUT:
            kind, said = "hang", f"{used:.1f} s; {said}"
        if kind in BAD or kind == "hang":
            keep(key, target.folder, [number, kind, what, said], asked)
        say(number, kind, what[:500], said[:2000], used)


def forget_peak() -> None:
    """The peak of memory is counted from now on."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def memory(what: str) -> int:
    """Bytes, of a line of /proc/self/status."""
    text = Path("/proc/self/status").read_text()
    return int(text.partition(f"{what}:")[2].split()[0]) << 10


def campaign(key: str, tally: Tally, asked: argparse.Namespace, folder: Path) -> None:
    """All inputs of a format that were not tried yet, or as many as fit into s of the processor."""
    known = {number for seed, a, b in tally.done if seed == asked.seed for number in range(a, b)}
    numbers = [n for n in range(asked.start, asked.start + asked.inputs) if n not in known]
    waiting = [[n[0], n[-1] + 1] for n in _runs(numbers)]
    if not waiting:
        return
    target = TARGETS[key](folder / "seeds")
    running: dict[int, Batch] = {}
    places = iter(range(1 << 30))
    spent = tally.seconds + asked.seconds

    def begin(first: int, last: int) -> None:
        batch = Batch(target, key, asked, first, last, folder / str(next(places)))
        running[batch.out] = batch

    while running or (waiting and not STOPPED and tally.seconds < spent):
        while waiting and len(running) < asked.jobs and not STOPPED and tally.seconds < spent:
            begin(*waiting.pop(0))
        for out in select.select(list(running), [], [], 1.0)[0]:
            batch = running[out]
            for report in batch.told():
                if len(report) == 1:
                    batch.began, batch.used = time.monotonic(), processor_time(batch.pid)
                    batch.under_way = report[0]
                else:
                    tally.note(*report)
                    batch.under_way, batch.at = None, report[0] + 1
                    if report[1] == "crash":
                        keep(key, batch.place, report, asked)
            if not batch.pid:
                del running[out]
                tally.done.append([asked.seed, batch.first, batch.at])
                if batch.at < batch.last:
                    waiting.insert(0, [batch.at, batch.last])
                shutil.rmtree(batch.place, ignore_errors=True)
        for out, batch in list(running.items()):
            if batch.pid and batch.hangs():
                batch.kill()
                os.waitpid(batch.pid, 0)
                os.close(out)
                del running[out]
                number = batch.at if batch.under_way is None else batch.under_way
                report = [number, "hang", "", f"{time.monotonic() - batch.began:.0f} s", TIMEOUT]
                tally.note(*report)
                keep(key, batch.place, report, asked)
                tally.done.append([asked.seed, batch.first, number + 1])
                if number + 1 < batch.last:
                    waiting.insert(0, [number + 1, batch.last])
                shutil.rmtree(batch.place, ignore_errors=True)


def _runs(numbers: list[int]) -> list[list[int]]:
    """Consecutive numbers in batches."""
    runs: list[list[int]] = []
    for number in numbers:
        if not runs or number != runs[-1][-1] + 1 or len(runs[-1]) == BATCH:
            runs.append([])
        runs[-1].append(number)
    return runs


def keep(key: str, place: Path, told: list[Any], asked: argparse.Namespace) -> None:
    """An input that something was found in, into the corpus."""
    number, kind, what, said = told[:4]
    if asked.keep is None:
        return
    folder = asked.keep / f"{key}-{asked.seed}-{number}-{kind.replace(' ', '-')}"
    folder.mkdir(parents=True, exist_ok=True)
    again = f"python benchmarks/fuzz.py {key} --seed {asked.seed} --only {number} --keep {folder}"
    (folder / "told.txt").write_text(f"{again}\n{kind}: {what}\n{said}\n", "utf-8")
    for name in ("input", "input.mcap", "input.zip", "input.toml"):
        made = place / name
        if made.is_dir():
            shutil.copytree(made, folder / name, symlinks=True, dirs_exist_ok=True)
        elif made.is_file():
            shutil.copy(made, folder / name)


def memory_folder() -> str | None:
    """A folder that is no disk, where there is one."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def processor_time(process: int) -> float:
    """S that a process has computed so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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


def row(key: str, tally: Tally) -> tuple[str, ...]:
    """The outcomes of one format, a cell for each of ``HEAD``."""
    inputs = tally.counts.total()
    cells = [TARGETS[key].name, f"{inputs:,}", *(f"{tally.counts[kind]:,}" for kind in KINDS)]
    seeds = ", ".join(map(str, sorted({seed for seed, _, _ in tally.done})))
    python = f"Python {platform.python_version()}"
    read_by = ", ".join([python, *(f"{name} {version(name)}" for name in TARGETS[key].read_by)])
    return (*cells, f"{1e3 * tally.seconds / max(inputs, 1):.1f}", seeds, read_by)


def table(rows: Iterable[tuple[str, ...]]) -> str:
    """Rows under their heads."""
    lines = [HEAD, ("---",) * len(HEAD), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def merged(old: Iterable[tuple[str, ...]], new: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Rows of a page and newer ones: an old one stays until as many inputs were tried under another seed."""
    new = list(new)
    done = {(name, seed) for name, *_, seed, _ in new}
    most = {name: int(inputs.replace(",", "")) for name, inputs, *_ in new}
    stays = [
        r
        for r in old
        if (r[0], r[-2]) not in done and int(r[1].replace(",", "")) > most.get(r[0], 0)
    ]
    order = [target.name for target in TARGETS.values()]
    return sorted([*stays, *new], key=lambda cells: (order.index(cells[0]), cells[-2]))


def write(page: Path, tallies: dict[str, Tally]) -> None:
    """The table of a page anew."""
    before, inside, after = re.split("|".join(map(re.escape, MARKS)), page.read_text("utf-8"))
    lines = [line for line in inside.splitlines() if line.startswith("|")][2:]
    old = [tuple(cell.strip() for cell in line.split("|")[1:-1]) for line in lines]
    ran = f'{platform.system()} {platform.machine()}; "ms each" is processor time.'
    rows = merged(old, (row(key, tally) for key, tally in tallies.items() if tally.done))
    page.write_text(f"{before}{MARKS[0]}\n{table(rows)}\n\n{ran}\n{MARKS[1]}{after}", "utf-8")


def stored(path: Path | None) -> dict[str, Tally]:
    """Read the counts of earlier runs."""
    if path is None or not path.is_file():
        return {}
    document = json.loads(path.read_text("utf-8"))
    return {key: Tally(**{**t, "counts": Counter(t["counts"])}) for key, t in document.items()}


def joined(one: Tally, other: Tally) -> Tally:
    """Add up the counts of two parts of a campaign."""
    return Tally(
        one.counts + other.counts, one.found + other.found, one.lies + other.lies,
        one.seconds + other.seconds, one.done + other.done,
    )  # fmt: skip


def once(key: str, asked: argparse.Namespace, folder: Path) -> int:
    """One input in this process."""
    (folder / "seeds").mkdir()
    target = TARGETS[key](folder / "seeds")
    target.folder = folder
    outcome = attempt(target, asked.only, asked.seed)
    print(outcome)
    if asked.keep is not None:
        keep(
            key,
            folder,
            [asked.only, "unforeseen" if not outcome.bad else outcome.kind, *outcome[1:], 0],
            asked,
        )
    return int(outcome.bad)


def main() -> int:
    """Run what the command line asks for; 1 when something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("formats", nargs="*", help=f"of {', '.join(TARGETS)}; all if none")
    parser.add_argument("--inputs", type=int, default=200, help="of each format")
    parser.add_argument("--start", type=int, default=0, help="number of the first one")
    parser.add_argument("--seed", type=int, default=datetime.now(UTC).toordinal())
    parser.add_argument("--only", type=int, help="one input again")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--seconds", type=float, default=math.inf, help="of the processor for each format, at most"
    )
    parser.add_argument("--keep", type=Path, help="folder for inputs in which something is found")
    parser.add_argument("--counts", type=Path, help="JSON of what was tried, which grows")
    parser.add_argument("--add", type=Path, nargs="+", default=(), help="other such files")
    parser.add_argument("--write", type=Path, help="a page with the table's marks")
    asked = parser.parse_args()
    formats = asked.formats or list(TARGETS)
    print(f"seed {asked.seed}", file=sys.stderr)
    folder = Path(tempfile.mkdtemp(prefix="fuzz", dir=memory_folder()))
    if asked.only is not None:
        try:
            return once(formats[0], asked, folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    signal.signal(signal.SIGTERM, lambda number, _: STOPPED.append(number))
    tallies = stored(asked.counts)
    for path in asked.add:
        for key, tally in stored(path).items():
            tallies[key] = joined(tallies.get(key, Tally()), tally)
    for key in formats:
        if STOPPED or not asked.inputs:
            break
        began, tally = time.monotonic(), tallies.setdefault(key, Tally())
        (folder / key / "seeds").mkdir(parents=True)
        campaign(key, tally, asked, folder / key)
        shutil.rmtree(folder / key, ignore_errors=True)
        took = f"{time.monotonic() - began:.0f} s, of the processor {tally.seconds:.0f} s"
        print(f"{key}: {dict(tally.counts)} in {took}", file=sys.stderr, flush=True)
        if asked.counts is not None:
            text = json.dumps({name: vars(t) for name, t in tallies.items()})
            asked.counts.write_text(text, "utf-8")
    shutil.rmtree(folder, ignore_errors=True)
    print(table(row(key, tallies[key]) for key in TARGETS if key in tallies))
    if asked.write is not None:
        write(asked.write, tallies)
    return int(any(tally.found for tally in tallies.values()))


if __name__ == "__main__":
    sys.exit(main())
