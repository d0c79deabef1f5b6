"""The crash campaign: everything that writes is killed, starved of disk and locked out, and goes on.

``python tests/faults/fault_campaign.py --kills 120 --write docs/reliability.md`` runs it and writes the page
with what was tried and what came of it.
"""

from __future__ import annotations

import argparse
import logging
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

HERE = Path(__file__).resolve().parent
if __name__ == "__main__":
    sys.path[:0] = [
        str(HERE),
        str(HERE.parent / "helpers"),
        str(HERE.parents[1] / "recorder"),
        str(HERE.parents[1]),
    ]

from aftermath import Row, after, left_of  # noqa: E402
from child import Child  # noqa: E402
from disk import small_disk  # noqa: E402
from file_victims import Auditor, LabelWriters  # noqa: E402
from object_store import object_store  # noqa: E402
from process_faults import denied, failing_disk, jumping_clock  # noqa: E402
from processes import children, pid_alive, ray_tasks, workers  # noqa: E402
from served_victim import ServedRecorder  # noqa: E402
from stores import (  # noqa: E402
    broken_store,
    failing_store,
    short_store,
    slow_store,
    throttling_store,
)
from victims import (  # noqa: E402
    ClusterScorer,
    Scorer,
    StoreScorer,
    Victim,
    prepared,
    writers,
)


def killed(victim: Victim, kills: int, chance: random.Random, place: Path) -> Row:
    """kill -9 at random moments between start and end."""
    row = Row(victim.name, "kill -9 at a random moment")
    place.mkdir()
    folder = place / "data"
    began = time.monotonic()
    first = Child(victim, folder)
    assert first.wait() == 0, first.said()
    first.committed()
    lasts = time.monotonic() - began
    before: set[str] = set()
    for _ in range(kills):
        # half of the time go on with what a killed run left, which is killed in its turn
        if chance.random() < 0.5 or before == victim.everything:
            shutil.rmtree(folder, ignore_errors=True)
            before = set()
        child = Child(victim, folder)
        time.sleep(chance.uniform(0, lasts))
        helpers = children(child.pid)
        child.kill()
        code = child.wait()
        row.tried += 1
        row.hit += code == -9
        gone(helpers)
        committed = child.committed() | before
        if chance.random() < 0.5:
            after(row, victim, folder, committed)
            before = victim.everything
        else:
            before = left_of(row, victim, folder, committed)
    after(row, victim, folder, before)
    return row


def gone(pids: list[int]) -> None:
    """Workers end with whoever started them; waits for that."""
    end = time.monotonic() + 30
    while any(pid_alive(pid) for pid in pids):
        assert time.monotonic() < end, "a worker outlived its run"
        time.sleep(0.02)


def workers_of(pid: int) -> list[int]:
    """Processes that judge episodes for a scorer, on this machine or on its cluster."""
    return workers(pid) + ray_tasks(pid)


def workers_killed(victim: Scorer, kills: int, chance: random.Random, place: Path) -> Row:
    """kill -9 of one worker process after the other while a run goes on: it must not notice."""
    row = Row(f"workers of the {victim.name}", "kill -9 at a random moment")
    place.mkdir()
    while row.hit < kills:
        folder = place / "data"
        shutil.rmtree(folder, ignore_errors=True)
        child = Child(victim, folder)
        spared: set[int] = set()
        while not child.ended():
            at_work = [pid for pid in workers_of(child.pid) if pid not in spared]
            if at_work and row.hit < kills and len(spared) < 3:
                time.sleep(chance.uniform(0, 3))
                pid = chance.choice(at_work)
                spared.add(pid)
                if pid_alive(pid):
                    os.kill(pid, 9)
                    row.hit += 1
            time.sleep(0.02)
        row.tried = row.hit
        child.committed()
        code = child.wait()
        if code not in (0, 2):  # 2: an episode whose process was killed twice is listed
            row.next_failed += 1
            row.said.add(f"exit code {code}: {child.said()}")
        row.kept += len(victim.everything)
        after(row, victim, folder, victim.everything if code == 0 else set())
    return row


def full_disk(victim: Victim, times: int, chance: random.Random, place: Path) -> Row:
    """The disk is full after some of the episodes, at another byte each time."""
    fault = "disk full"
    with small_disk(place) as disk:
        if not disk.mounted:
            fault = "file grows beyond its bound (no file system could be mounted)"
        row = Row(victim.name, fault)
        whole = Child(victim, disk.folder)
        assert whole.wait() == 0, whole.said()
        whole.committed()
        most = disk.used() if disk.mounted else 20_000
        for _ in range(times):
            shutil.rmtree(disk.folder, ignore_errors=True)
            child = Child(victim, disk.folder, disk.fill(chance.randrange(most)))
            code = child.wait()
            committed = child.committed()
            row.tried += 1
            row.hit += code != 0
            if code not in (0, 1, 2):
                row.said.add(f"CRASH: exit code {code}: {child.said()}")
                row.next_failed += 1
            disk.make_room()
            after(row, victim, disk.folder, committed)
    return row


def read_only(victim: Victim, chance: random.Random, place: Path) -> Row:
    """Some episodes are there, and the folder may not be written to any more."""
    with small_disk(place) as disk:
        row = Row(victim.name, "folder cannot be written to")
        if not disk.mounted and os.geteuid() == 0:
            return row  # rights mean nothing to this user
        child = Child(victim, disk.folder)
        time.sleep(chance.uniform(0, 0.3))
        child.kill()
        child.wait()
        committed, before = child.committed(), victim.left(disk.folder)
        with disk.read_only():
            child = Child(victim, disk.folder)
            code = child.wait()
            child.committed()
            row.tried, row.hit = 1, int(code != 0)
            if code not in (0, 1, 2) or (code == 0 and before != victim.everything):
                row.next_failed += 1
                row.said.add(f"exit code {code}: {child.said()}")
            row.lost += len(before - victim.left(disk.folder))
        after(row, victim, disk.folder, committed)
    return row


def campaign(
    asked: argparse.Namespace, place: Path, write: Callable[[list[Row]], None]
) -> list[Row]:
    """All faults; ``write`` is called after each row. Each writer is killed and has its faults; what only reads has a few of each."""
    chance = random.Random(asked.seed)
    source = prepared(place)
    scorer = Scorer(source)
    every: list[Victim] = [Auditor(source), LabelWriters(source), *writers(source)]
    if not asked.of or ServedRecorder.name in asked.of:
        every.append(ServedRecorder(source))
    every = [v for v in [*every, scorer] if not asked.of or v.name in asked.of]
    share, few = -(-asked.kills // (len(every) + 1)), max(1, asked.kills // 50)
    half = max(1, asked.faults // 2)
    rows: list[Row] = []
    began = time.monotonic()

    def add(kind: str, fault: Callable[..., Row], *given: object) -> None:
        if kind in asked.only:
            rows.append(fault(*given, chance, place / f"{kind}{len(rows)}"))
            write(rows)
            took = time.monotonic() - began
            print(f"{took:.0f} s: {rows[-1]}", file=sys.stderr, flush=True)

    for victim in every:
        add("kills", killed, victim, share)
    add("workers", workers_killed, scorer, share)
    add("cluster", workers_killed, ClusterScorer(source), few)
    for victim in every:
        add("writes", failing_disk, victim, asked.faults)
        add("rights", denied, victim, half)
        add("clock", jumping_clock, victim, half)
        add("disks", full_disk, victim, asked.disks)
        add("disks", read_only, victim)
    with object_store() as store:
        distant = StoreScorer(source, store)
        add("store", killed, distant, few)
        for fault in (slow_store, failing_store, throttling_store, short_store, broken_store):
            add("store", fault, distant, few)
    return rows


KINDS = ("kills", "workers", "cluster", "writes", "rights", "clock", "disks", "store")

HEADS = (
    "what was at work", "what happened", "times", "of these, while it worked", "episodes written before",
    "lost", "half files taken for whole", "next run failed",
)  # fmt: skip


def table(rows: list[Row], before: Iterable[str] = ()) -> str:
    """Render as Markdown; rows of an earlier run stay where this one has none for the same fault."""
    lines = {_about(line): line for line in before}
    for r in rows:
        if r.tried:
            cells = (r.victim, r.fault, r.tried, r.hit, r.kept, r.lost, r.halves, r.next_failed)
            line = f"| {' | '.join(map(str, cells))} |"
            lines[_about(line)] = line
    tried = sum(int(line.split("|")[3]) for line in lines.values())
    head = "| " + " | ".join(HEADS) + " |\n" + "|---" * len(HEADS) + "|"
    return f"{tried} kills and faults:\n\n" + "\n".join([head, *lines.values()]) + "\n"


def _about(line: str) -> str:
    return "|".join(line.split("|")[1:3])


BEGIN, END = "<!-- campaign -->\n", "<!-- end of campaign -->\n"


def main() -> int:
    """Exit code 1 if anything was lost, taken for whole, or did not go on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=120, help="over all writers")
    parser.add_argument("--faults", type=int, default=5, help="failing writes for each writer")
    parser.add_argument("--disks", type=int, default=3, help="full disks for each writer")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=KINDS, help="kinds of faults")
    parser.add_argument("--write", type=Path, help="page whose table is replaced")
    parser.add_argument("--of", nargs="+", metavar="NAME", help="writers, as the table names them")
    args = parser.parse_args()
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # the store's, a line per request

    def write(rows: list[Row]) -> None:
        if args.write:
            head, rest = args.write.read_text("utf-8").split(BEGIN)
            inside, tail = rest.split(END)
            before = [line for line in inside.splitlines() if line.startswith("| ")][1:]
            kept = before if args.of or set(args.only) != set(KINDS) else []
            args.write.write_text(head + BEGIN + table(rows, kept) + END + tail, "utf-8")

    with tempfile.TemporaryDirectory() as place:
        rows = campaign(args, Path(place), write)
    print(table(rows))
    for row in rows:
        for line in sorted(row.said):
            print(f"{row.victim}, {row.fault}: {line}", file=sys.stderr)
    return int(any(row.lost or row.halves or row.next_failed for row in rows))


if __name__ == "__main__":
    sys.exit(main())
