"""Coverage-guided fuzzing with Atheris, from the same sound seeds as the campaign.

    pip install 'safestage[fuzz]'
    python tests/fuzz/atheris_run.py mcap --seconds 300

What libFuzzer's own changes seldom do, damage at edges, is done by ``damage.py`` half of the time. An
input that is judged otherwise than the sound file, or ends in an error that nobody foresaw, ends the run
and is kept.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from types import FunctionType

ROOT = Path(__file__).resolve().parents[2]
PLACES = ("tests/fuzz", "tests/helpers", "recorder", ".")

FOLLOWED = [
    *(f"safestage_eval.formats.{name}" for name in (
        "discover", "ply", "trace_files",
        "mcap.mcap_arrays", "mcap.mcap_chunks", "mcap.mcap_clouds", "mcap.mcap_frames",
        "mcap.mcap_messages", "mcap.mcap_metadata", "mcap.mcap_reader", "mcap.mcap_records",
        "parquet.arrow_tables", "parquet.dataset_reader", "parquet.dataset_tables",
        "parquet.episode_row", "parquet.episodes_table", "parquet.row_index", "parquet.stored_contacts",
        "parquet.stored_scene", "parquet.stored_table", "parquet.table_digests",
        "parquet.table_file",
    )),
    "safestage_eval.rules",
    "safestage_eval.episode.invariants",
    "tomllib",
]  # fmt: skip
"""Modules whose branches count; compiled kernels cannot be followed."""

One = Callable[[bytes], None]


class Found(Exception):  # noqa: N818 — it is no error of this program
    """Something that may not be."""


def mcap(folder: Path) -> tuple[list[bytes], One]:
    """One file of one episode."""
    from mcap_target import Mcap
    from oracle import judged
    from seeds import rules

    target = Mcap(folder)
    sound, whole = target.seeds[0]

    def one(data: bytes) -> None:
        path = folder / "input.mcap"
        path.write_bytes(data)
        result = judged(path, whole, "", rules(), damage=True)
        if result.bad:
            raise Found(result)

    return [sound], one


def parquet(folder: Path) -> tuple[list[bytes], One]:
    """One table of a dataset; the first byte says which."""
    from oracle import judged
    from parquet_target import Parquet
    from seeds import rules

    seed, whole = Parquet(folder).seeds[0]
    files = sorted(seed.rglob("*.parquet"))
    tables = [file.read_bytes() for file in files]

    def one(data: bytes) -> None:
        if not data:
            return
        at = data[0] % len(files)
        files[at].write_bytes(data[1:])
        result = judged(seed, whole, files[at].parent.name, rules(), damage=True)
        files[at].write_bytes(tables[at])
        if result.bad:
            raise Found(result)

    return [bytes([at]) + data for at, data in enumerate(tables)], one


def rules(folder: Path) -> tuple[list[bytes], One]:
    """A rule file."""
    from text_target import Rules

    from safestage_eval.rules import RuleErrors

    target, path = Rules(folder), folder / "input.toml"

    def one(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(RuleErrors):
            target.load(path)

    return [sound.text for sound in target.sound], one


TARGETS = {"parquet": parquet, "mcap": mcap, "rules": rules}


def followed() -> list[FunctionType]:
    """Functions and methods of the modules that are loaded by now and whose branches count."""
    found = {}
    for name, module in list(sys.modules.items()):
        if not any(name == one or name.startswith(f"{one}.") for one in FOLLOWED):
            continue
        kinds = [thing for thing in vars(module).values() if isinstance(thing, type)]
        for thing in (*vars(module).values(), *(m for kind in kinds for m in vars(kind).values())):
            if isinstance(thing, FunctionType) and thing.__module__ == name:
                found[thing.__code__] = thing
    return list(found.values())


def fuzz(key: str, seconds: int, folder: Path) -> None:
    """Never returns: libFuzzer ends the process."""
    import atheris

    sys.path[:0] = [str(ROOT / place) for place in PLACES]
    from damage import damaged

    seeds, one = TARGETS[key](folder)
    for function in followed():
        atheris.instrument_func(function)
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, data in enumerate(seeds):
        (corpus / str(number)).write_bytes(data)

    def changed(data: bytes, most: int, seed: int) -> bytes:
        rng = Random(seed)
        if rng.random() < 0.5:
            return bytes(atheris.Mutate(data, most))
        return damaged(rng, bytes(data))[0][:most]

    flags = [
        f"-max_total_time={seconds}", f"-max_len={2 * max(map(len, seeds))}", "-timeout=60",
        "-rss_limit_mb=4096", "-print_final_stats=1", "-seed=1", f"-artifact_prefix={folder}/found-",
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *flags, str(corpus)], one, custom_mutator=changed)
    atheris.Fuzz()


def main() -> int:
    """Run one target in a process of its own, and say what it came to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--seconds", type=int, default=300)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.folder is not None:
        fuzz(asked.target, asked.seconds, asked.folder)
    folder = Path(tempfile.mkdtemp(prefix=f"atheris-{asked.target}-"))
    again = [sys.executable, __file__, asked.target, "--seconds", str(asked.seconds)]
    done = subprocess.run(
        [*again, "--folder", str(folder)],
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
    )
    runs = re.findall(r"stat::number_of_executed_units:\s+(\d+)", done.stderr)
    branches = re.findall(r"\bcov: (\d+)", done.stderr)
    found = sorted(folder.glob("found-*"))
    if done.returncode or found or not runs:
        names = ", ".join(file.name for file in found)
        sys.stderr.write(f"{done.stderr[-4000:]}\n{asked.target}: kept in {folder}: {names}\n")
        return 1
    shutil.rmtree(folder)
    sys.stdout.write(
        f"{asked.target}: {int(runs[-1]):,} executions, {int(branches[-1]):,} branches seen "
        f"(of the seeds {int(branches[0]):,}), nothing found\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
