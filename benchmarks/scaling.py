"""How much faster many episodes are scored by several workers, and what keeps it from being more.

    python benchmarks/scaling.py TRACES                       # 1, 2, 4, 8, 16 workers, as many as there are cores
    python benchmarks/scaling.py TRACES --workers 1,16 --runs 3 --assigned

Each row runs ``safestage-score TRACES --rules rules/ --jobs N`` anew, files in the
page cache; rows take turns, and what is printed are medians. Processor time is that of the process that
was started, of the one that workers are forked from, and of all workers, looked at 50 times a second; the
first and half of the second are what more workers cannot share. Memory is the most that one worker held.
Linux only.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from machine import machine

TICK = os.sysconf("SC_CLK_TCK")
LOOK = 0.02
"""s between two looks at the processes of a run."""


@dataclass
class Run:
    """One run, as it was seen.

    Attributes:
        clock: s.
        cpu: s of the processor by process id, in the order in which they were met.
        memory: most bytes held at a time, likewise.
    """

    clock: float = 0.0
    cpu: dict[int, float] = field(default_factory=dict)
    memory: dict[int, int] = field(default_factory=dict)
    parents: dict[int, int] = field(default_factory=dict)

    def look(self, session: int) -> None:
        """Note what each process of a session has used so far."""
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                text = (entry / "stat").read_text("ascii", errors="replace")
                status = (entry / "status").read_text("ascii", errors="replace")
            except OSError:  # it has ended
                continue
            fields = text.rpartition(")")[2].split()
            if int(fields[3]) == session:
                pid = int(entry.name)
                self.parents.setdefault(pid, int(fields[1]))
                self.cpu[pid] = (int(fields[11]) + int(fields[12])) / TICK
                peak = [line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")]
                self.memory[pid] = max(self.memory.get(pid, 0), *(int(kB) << 10 for kB in peak), 0)

    def shares(self, main: int) -> tuple[float, float, float]:
        """Processor time (s) of the first process, of the fork server, of the workers."""
        parents = set(self.parents.values()) - {main}
        server = sum(cpu for pid, cpu in self.cpu.items() if pid in parents and pid != main)
        rest = sum(cpu for pid, cpu in self.cpu.items() if pid not in parents | {main})
        return self.cpu.get(main, 0.0), server, rest

    def largest(self, main: int) -> int:
        """Bytes of the largest worker; of the first process where there is none."""
        others = [memory for pid, memory in self.memory.items() if pid != main]
        return max(others or self.memory.values(), default=0)


def score(command: list[str]) -> tuple[Run, int]:
    """Run it and watch; the run, and the id of its first process. Raises SystemExit if it fails."""
    run, began = Run(), time.perf_counter()
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    ) as process:
        while process.poll() is None:
            run.look(process.pid)
            time.sleep(LOOK)
        run.clock = time.perf_counter() - began
    if process.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: exit {process.returncode}")
    return run, process.pid


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("traces", nargs="+")
    parser.add_argument("--rules", default="rules")
    parser.add_argument("--assigned", action="store_true", help="by the assigned rules alone")
    parser.add_argument("--workers", default="1,2,4,8,16")
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    cores = len(os.sched_getaffinity(0))
    numbers = [number for number in map(int, args.workers.split(",")) if number <= max(cores, 2)]
    rows: dict[int, list[tuple[Run, int]]] = {number: [] for number in numbers}
    print(f"{machine()}, {cores} cores")
    with tempfile.TemporaryDirectory() as folder:
        tail = ["--rules", args.rules, "-f", "parquet", "-o", str(Path(folder) / "rows.parquet")]
        tail += ["--assigned"] * args.assigned
        program = "from safestage_eval.cli import score_main; score_main()"
        for attempt in range(args.runs + 1):
            for number in numbers:
                command = [sys.executable, "-c", program, *args.traces, *tail]
                found = score([*command, "--jobs", str(number)])
                if attempt:  # the first one compiles, and brings files into the page cache
                    rows[number].append(found)
    head = ("workers", "clock s", "times one", "processor s", "first process", "fork server", "MB")
    print("".join(f"{word:>15}" for word in head))
    alone = median(run.clock for run, _ in rows[numbers[0]])
    for number, runs in rows.items():
        clock = median(run.clock for run, _ in runs)
        all_cpu = median(sum(run.cpu.values()) for run, _ in runs)
        first, server, _ = (
            median(each) for each in zip(*(run.shares(pid) for run, pid in runs), strict=True)
        )
        memory = median(run.largest(pid) for run, pid in runs) / 1e6
        cells = (clock, alone / clock, all_cpu, first, server)
        print(f"{number:15}" + "".join(f"{cell:15.2f}" for cell in cells) + f"{memory:15.0f}")


if __name__ == "__main__":
    main()
