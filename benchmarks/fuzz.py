"""The campaign: many hostile inputs of each format, in a process that may die, hang or swell.

    python benchmarks/fuzz.py                        # 10,000 inputs of every format
    python benchmarks/fuzz.py mcap --inputs 500      # of one format
    python benchmarks/fuzz.py mcap --only 1234       # one input again, which is left in --folder

Each input follows from the format's name and its number alone.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / place) for place in ("tests/fuzz", "tests", "tests/importers", ".")]

from outcome import BAD  # noqa: E402
from targets import TARGETS, attempt  # noqa: E402

TIMEOUT = 20.0
"""s of processor time that an input may take; a busy machine makes no hang of it."""

ASLEEP = 300.0
"""s after which an input hangs however little of the processor it took: it waits for something."""

MEMORY = 6 << 30
"""Bytes of address space of the process: what it reserves, of which it uses far less."""


def worker(key: str, first: int, last: int, folder: Path) -> None:
    """Inputs one after the other; a line about each on stdout."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    target = TARGETS[key](folder)
    for number in range(first, last):
        print(json.dumps([number]), flush=True)
        kind, what, said = attempt(target, number)
        print(json.dumps([number, kind, what, said]), flush=True)


@dataclass
class Tally:
    """What a campaign of one format came to."""

    counts: Counter[str] = field(default_factory=Counter)
    found: list[tuple[int, str, str, str]] = field(default_factory=list)

    def note(self, number: int, kind: str, what: str, said: str) -> None:
        """One input."""
        self.counts[kind] += 1
        if kind not in BAD and kind not in ("crash", "hang"):
            return
        self.found.append((number, kind, what, said))


def campaign(key: str, inputs: int, folder: Path, first: int = 0) -> Tally:
    """All inputs of a format; the process is begun anew after each that kills it."""
    tally, at, last = Tally(), first, first + inputs
    while at < last:
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
            while True:
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


def processor_time(process: int) -> float:
    """S that a process has computed so far."""
    told = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


def table(tallies: dict[str, Tally]) -> str:
    """The outcomes as Markdown."""
    kinds = (
        "same",
        "unknown",
        "problem",
        "read",
        "unforeseen",
        "changed",
        "false pass",
        "crash",
        "hang",
    )
    head = (
        "format", "inputs", "same verdicts", "inconclusive", "listed problem", "read",
        "unforeseen error", "other verdict", "false pass", "crash", "hang",
    )  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for key, tally in tallies.items():
        cells = [TARGETS[key].name, f"{tally.counts.total():,}"]
        cells += [f"{tally.counts[kind]:,}" for kind in kinds]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> int:
    """Run what the command line asks for; 1 when something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("formats", nargs="*", help=f"of {', '.join(TARGETS)}; all if none")
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path)
    asked = parser.parse_args()
    formats = asked.formats or list(TARGETS)
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="fuzz"))
    if asked.worker:
        worker(formats[0], *asked.worker, folder)
        return 0
    if asked.only is not None:
        folder.mkdir(parents=True, exist_ok=True)
        print(attempt(TARGETS[formats[0]](folder), asked.only))
        print(folder)
        return 0
    tallies = {}
    for key in formats:
        began = time.monotonic()
        tallies[key] = campaign(key, asked.inputs, folder / key, asked.first)
        print(
            f"{key}: {dict(tallies[key].counts)} in {time.monotonic() - began:.0f} s",
            file=sys.stderr,
        )
        for number, kind, what, said in tallies[key].found:
            print(f"{key} {number} {kind}: {what}: {said}", file=sys.stderr)
    print(table(tallies))
    if asked.folder is None:
        shutil.rmtree(folder, ignore_errors=True)
    return int(any(tally.found for tally in tallies.values()))


if __name__ == "__main__":
    sys.exit(main())
