"""A corpus of many thousand episodes: what scoring it takes, in time and in memory.

    python benchmarks/corpus.py make DIR --distinct 2000 --episodes 35000
    python benchmarks/corpus.py score DIR                 # cold, all, again, under another limit
    python benchmarks/corpus.py score DIR --ray --kill    # and through Ray, a worker killed
    python benchmarks/corpus.py score DIR --visits 4      # only four of the datasets

``make`` writes ``--distinct`` episodes of full size (made.py), each another place of the same scene,
in shards of 50, and then as many datasets that visit the same files under other ids as the corpus
needs: hard links, so the disk holds each trace once. Times are by the clock. Cold means that the
system was asked to forget the files first; later visits find them in the page cache if they fit.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import made
import numpy as np
import pyarrow.parquet as pq
from machine import machine

from safestage_eval.episode import Episode
from safestage_eval.formats.parquet.arrow_tables import write_options
from safestage_eval.formats.parquet.dataset_writer import writing_shard

STAGES = tuple(made.ROLES)
SHARD = 50
TABLES = ("bodies", "contacts", "frames", "geometry", "assets", "channels", "states")


# ---------------------------------------------------------------- making it


def moved(episode: Episode, seed: int) -> Episode:
    """The whole scene somewhere else on the floor: another trace with the same verdicts."""
    rng = np.random.default_rng(seed)
    by = np.append(rng.uniform(-0.5, 0.5, 2), 0).astype(np.float32)
    tracks = {
        name: replace_columns(track, position=track.position + by)
        for name, track in episode.tracks.items()
    }
    contacts = replace_columns(episode.contacts, position=episode.contacts.position + by)
    header = episode.header.model_copy(
        update={"episode_id": f"{episode.header.stage}.{seed:06d}", "seed": seed, "rollout": 0}
    )
    return replace(episode, header=header, tracks=tracks, _contacts=contacts, path=None)


def replace_columns(record: Any, **columns: Any) -> Any:
    """Return the record with other columns."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    return type(record)(**(values | columns))


def shard(job: tuple[Path, int, int, int]) -> None:
    """Write a shard of distinct episodes, unless it is there."""
    dataset, number, count, frames = job
    name = f"shard-{number:05d}"
    if (dataset / "meta/episodes" / f"{name}.parquet").exists():
        return
    bases = [made.make(stage, made.Size(frames=frames), seed=7).episode() for stage in STAGES]
    with writing_shard(dataset, name, number * SHARD) as target:
        for i in range(number * SHARD, number * SHARD + count):
            target.add(moved(bases[i % len(bases)], i))


def make(folder: Path, distinct: int, episodes: int, frames: int, jobs: int) -> None:
    """Write the corpus."""
    first = folder / "visit-000"
    todo = [
        (first, number, min(SHARD, distinct - number * SHARD), frames)
        for number in range(-(-distinct // SHARD))
    ]
    began = time.monotonic()
    shard(todo[0])  # alone: it makes the folder
    with ProcessPoolExecutor(jobs) as pool:
        for done, _ in enumerate(pool.map(shard, todo[1:]), 2):
            print(f"{done} of {len(todo)} shards, {time.monotonic() - began:.0f} s", flush=True)
    left, visit = episodes - distinct, 1
    while left > 0:
        left -= _visit(first, folder / f"visit-{visit:03d}", visit, left)
        visit += 1


def _visit(first: Path, there: Path, visit: int, most: int) -> int:
    """Copy the traces under other ids; return how many."""
    shutil.rmtree(there, ignore_errors=True)
    (there / "meta/episodes").mkdir(parents=True)
    shutil.copy(first / "meta/info.json", there / "meta/info.json")
    for table in TABLES:
        for path in (first / table).glob("*"):
            (there / table).mkdir(exist_ok=True)
            os.link(path, there / table / path.name)
    count = 0
    for path in sorted((first / "meta/episodes").glob("*.parquet")):
        table = pq.read_table(path)[: max(0, most - count)]
        if not len(table):
            break
        rows = table.to_pylist()
        for row in rows:
            row["episode_id"] += f".r{visit}"
            row["rollout"] = visit
        changed = type(table).from_pylist(rows, schema=table.schema)
        options = write_options("meta/episodes")
        pq.write_table(changed, there / "meta/episodes" / path.name, **options)
        count += len(rows)
    return count


# ---------------------------------------------------------------- scoring it


def forget(folder: Path) -> None:
    """Ask the system to drop the files from its page cache."""
    os.sync()
    for path in folder.rglob("*"):
        if path.is_file():
            number = os.open(path, os.O_RDONLY)
            os.posix_fadvise(number, 0, 0, os.POSIX_FADV_DONTNEED)
            os.close(number)


def processes(root: int) -> dict[int, tuple[str, int]]:
    """Pid → (command line, resident bytes) of a process and all below it."""
    parents: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(path.parent.name)] = int(path.read_bytes().rpartition(b")")[2].split()[1])
        except OSError:
            continue
    found = {}
    for pid in parents:
        above: int | None = pid
        while above is not None and above != root:
            above = parents.get(above)
        if above == root:
            try:
                words = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
                pages = int(Path(f"/proc/{pid}/statm").read_text("ascii").split()[1])
            except OSError:
                continue
            found[pid] = words, pages * os.sysconf("SC_PAGE_SIZE")
    return found


def scored(traces: list[Path], out: Path, *options: str, kill: bool = False) -> dict[str, Any]:
    """Run the command; seconds by the clock and of processors, and the most memory of a process."""
    command = [sys.executable, "-c", "from safestage_eval.cli import score_main; score_main()"]
    words = [*map(str, traces), "--assigned", "-f", "parquet", "-o", str(out), *options]
    before, began = os.times(), time.monotonic()
    run = subprocess.Popen([*command, *words], stderr=subprocess.PIPE, text=True)
    driver: list[int] = []
    worker: list[int] = []
    killed = False
    while run.poll() is None:
        found = processes(run.pid)
        driver.append(found.get(run.pid, ("", 0))[1])
        at_work = [held for line, held in found.values() if "spawn_main" in line]
        worker.append(max(at_work, default=0))
        for pid, (line, _) in found.items():
            if pid != run.pid:
                old_enough = time.monotonic() - began > 20
                if kill and not killed and old_enough and "ray::_judge_chunk" in line:
                    os.kill(pid, signal.SIGKILL)
                    killed = True
        time.sleep(0.5)
    taken, after = time.monotonic() - began, os.times()
    said = run.stderr.read().strip() if run.stderr else ""
    half = len(driver) // 2
    return {
        "exit code": run.returncode,
        "s": round(taken, 1),
        "processor s": round(sum(after[2:4]) - sum(before[2:4]), 1),
        "driver MB": round(max(driver, default=0) / 2**20),
        "driver MB until halfway": round(max(driver[:half], default=0) / 2**20),
        "worker MB": round(max(worker, default=0) / 2**20),
        "worker MB until halfway": round(max(worker[:half], default=0) / 2**20),
        "killed": killed,
        "said": said.splitlines()[-1] if said else "",
    }


def same(one: Path, other: Path) -> bool:
    """Whether two result files say the same, row by row."""
    return bool(pq.read_table(one).equals(pq.read_table(other)))


def score(folder: Path, work: Path, jobs: int, most: int | None, *, ray: bool, kill: bool) -> None:
    """Print one JSON line per run."""
    visits = sorted(folder.glob("visit-*"))[:most]
    count = sum(
        pq.read_metadata(path).num_rows
        for visit in visits
        for path in (visit / "meta/episodes").glob("*.parquet")
    )
    distinct = sum(
        pq.read_metadata(path).num_rows for path in (visits[0] / "meta/episodes").glob("*.parquet")
    )
    stored = sum(path.stat().st_size for path in visits[0].rglob("*") if path.is_file())
    print(f"{machine()}, {count} episodes, of these "
          f"{distinct} distinct in {stored / 2**30:.1f} GiB, {jobs} processes")  # fmt: skip
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)

    def told(name: str, episodes: int, found: dict[str, Any]) -> None:
        rate = {"episodes": episodes, "ms per episode": round(1000 * found["s"] / episodes, 2)}
        print(json.dumps({"run": name, **rate, **found}), flush=True)

    processes_ = ("-j", str(jobs))
    kept = ("--resume", str(work / "kept"), *processes_)
    forget(folder)
    cold = scored(visits[:1], work / "cold.parquet", "--resume", str(work / "cold"), *processes_)
    told("each distinct one, cold", distinct, cold)
    told("all", count, scored(visits, work / "all.parquet", *kept))
    told("again, all known", count, scored(visits, work / "again.parquet", *kept))
    print("again says the same:", same(work / "all.parquet", work / "again.parquet"))
    changed = scored(visits[:1], work / "other.parquet", *kept, "--set", "edge=3 cm")
    told("each distinct one, another limit of FSH101", distinct, changed)
    if ray:
        options = ("--engine", "ray", "--resume", str(work / "ray"))
        found = scored(visits, work / "ray.parquet", *options, kill=kill)
        told("through Ray", count, found)
        print("Ray says the same:", same(work / "all.parquet", work / "ray.parquet"))


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make")
    making.add_argument("folder", type=Path)
    making.add_argument("--distinct", type=int, default=2000)
    making.add_argument("--episodes", type=int, default=35_000)
    making.add_argument("--frames", type=int, default=8000)
    scoring = commands.add_parser("score")
    scoring.add_argument("folder", type=Path)
    scoring.add_argument("--work", type=Path, help="results go there; default: DIR-results")
    scoring.add_argument("--visits", type=int, help="only so many of the datasets")
    scoring.add_argument("--ray", action="store_true")
    scoring.add_argument("--kill", action="store_true")
    for command in (making, scoring):
        command.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
    if args.command == "make":
        make(args.folder, args.distinct, args.episodes, args.frames, args.jobs)
        return
    work = args.work or args.folder.with_name(f"{args.folder.name}-results")
    score(args.folder, work, args.jobs, args.visits, ray=args.ray, kill=args.kill)


if __name__ == "__main__":
    main()
