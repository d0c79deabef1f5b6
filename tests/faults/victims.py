"""Everything that writes: how it is started, what must be true of what it left, and how it goes on."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from exports import map_text, write_lerobot
from object_store import Between, upload
from recordings import falling_cube
from scenes import Scene

from safestage_eval.cli import main
from safestage_eval.episode import check
from safestage_eval.errors import InputError
from safestage_eval.formats import discover, save
from safestage_eval.run.run_ledger import FILE, Ledger
from safestage_eval.run.score_traces import score_paths

EPISODES = 8
RULES = "fsh"

Commit = Callable[[str], None]
"""Told the id of an episode when it has been written for good."""


def names() -> list[str]:
    """Ids of the episodes that are written again and again."""
    return [f"e{i}" for i in range(EPISODES)]


def recording(name: str):
    """A falling cube, of another length for each id; equal each time."""
    return falling_cube(
        name, frames=40 + 5 * int(name[1:]), task=f"t{int(name[1:]) % 3}", policy="p", stage="FSH",
        roles={"target": ("cube",)}, rules=("FSH101",), success=True, success_time=0.1,
    )  # fmt: skip


def truth(folder: Path) -> dict[str | None, str]:
    """Id → content hash of the episodes in a folder."""
    return {ref.episode_id: ref.open().content_hash for ref in discover(folder)}


class Victim(ABC):
    """Something that writes."""

    name: str

    def __init__(self, source: Path) -> None:
        """``source``: a folder with all episodes, ready."""
        self.source = source
        self.truth = truth(source)

    @property
    def everything(self) -> set[str]:
        """Ids of all episodes that there are in the end."""
        return set(self.truth)

    @abstractmethod
    def go(self, folder: Path, commit: Commit) -> int:
        """Write everything that is not there yet into a folder; the exit code."""

    def left(self, folder: Path) -> set[str]:
        """Ids that are there, whole and as they should be.

        Raises AssertionError for half a file that passes for a whole one.
        """
        if not folder.is_dir() or not any(folder.iterdir()):
            return set()
        try:
            refs = discover(folder)
        except InputError as error:
            assert "no episode in here" in str(error), error
            return set()
        for ref in refs:
            assert ref.problem is None, f"{ref.path} passes for an episode: {ref.problem}"
            try:
                episode = ref.open()
                assert not check(episode)
            except InputError as error:
                raise AssertionError(f"{ref.path} passes for an episode: {error}") from None
            assert episode.content_hash == self.truth[ref.episode_id] == ref.content_hash
        assert len({ref.episode_id for ref in refs}) == len(refs)
        return {ref.episode_id for ref in refs}


class Recorder(Victim):
    """Records what is not there yet, as ``safestage bench record`` does, with the public writer."""

    def __init__(self, source: Path, form: str) -> None:
        """``form``: parquet or mcap."""
        super().__init__(source)
        self.name, self._form = f"recorder ({form})", form

    def go(self, folder: Path, commit: Commit) -> int:
        """Exit code 2 when an episode could not be written."""
        there = self.left(folder)
        for name in names():
            if name in there:
                continue
            try:
                path = folder if self._form == "parquet" else folder / f"{name}.mcap"
                recording(name).close(path)
            except (InputError, OSError) as error:
                sys.stderr.write(f"{error}\n")
                return 2
            commit(name)
        return 0


class Command(Victim):
    """A command that copies the source to a folder."""

    def __init__(self, source: Path, name: str, *arguments: str) -> None:
        """``arguments``: ``{source}`` and ``{out}`` are filled in."""
        super().__init__(source)
        self.name, self._arguments = name, arguments

    def go(self, folder: Path, commit: Commit) -> int:
        """The command's own exit code."""
        words = [a.format(source=self.source, out=folder) for a in self._arguments]
        return main_with(words)


class Importer(Command):
    """Imports a LeRobot dataset with a map file, both made beside the source."""

    def __init__(self, source: Path) -> None:
        foreign, scene = source.parent / "foreign", source.parent / "map.toml"
        super().__init__(
            source, "importer", "import", str(foreign), "--to", "{out}", "--map", str(scene),
            "-r", RULES, "-j", "1",
        )  # fmt: skip
        shutil.rmtree(foreign, ignore_errors=True)
        pushed = [
            Scene(frames, 20.0)
            .fixed("table")
            .box("cube", 0.02, np.linspace((0, 0, 0.02), (0.1, 0, 0.02), frames))
            .episode(task="push", stage="FSH", success=False)
            for frames in range(30, 30 + EPISODES)
        ]
        columns = write_lerobot(foreign, pushed)[1]
        scene.write_text(map_text(pushed[0]) + columns, "utf-8")
        with TemporaryDirectory() as place:
            assert self.go(Path(place) / "all", lambda name: None) == 0
            self.truth = truth(Path(place) / "all")
        assert len(self.truth) == EPISODES


class Scorer(Victim):
    """Scores the source, keeping results in the folder."""

    name = "scorer"

    def __init__(self, source: Path) -> None:
        super().__init__(source)
        self.traces, self.engine = str(source), ("-j", "2")
        self.results = {r.episode_id: r for r in score_paths([source], [RULES], jobs=1).results}

    def go(self, folder: Path, commit: Commit) -> int:
        """0 when it wrote the whole output, and that is right."""
        words = ["score", self.traces, "-r", RULES, "--resume", str(folder), "-f", "json"]
        out = folder.parent / "out.json"
        code = main_with([*words, *self.engine, "-o", str(out)])
        if code == 0:
            rows = json.loads(out.read_text("utf-8"))["episodes"]
            wanted = [row for result in self.results.values() for row in result.rows()]
            key = ("episode_id", "rule", "verdict", "time", "rule_digest", "trace_hash")
            assert [[r[k] for k in key] for r in rows] == [[w[k] for k in key] for w in wanted]
        return code

    def left(self, folder: Path) -> set[str]:
        """Ids of the results that are kept, each compared with the truth."""
        found = set()
        if not (folder / FILE).is_file():
            return found
        kept = Ledger(folder)
        with closing(sqlite3.connect(folder / FILE)) as db:
            keys = [key for (key,) in db.execute("SELECT key FROM kept")]
        for key in keys:
            line = kept.find(key)
            assert line is not None, f"{key} is half a result"
            document = json.loads(line)
            truth = self.results[document["episode_id"]]
            assert document["trace_hash"] == truth.trace_hash
            verdicts = [(v["rule"], v["verdict"], v["time"]) for v in document["verdicts"]]
            assert verdicts == [(v.rule, v.verdict, v.time) for v in truth.verdicts]
            found.add(document["episode_id"])
        return found


class ClusterScorer(Scorer):
    """Score through a Ray cluster of this machine."""

    name = "scorer on a Ray cluster"

    def __init__(self, source: Path) -> None:
        super().__init__(source)
        self.engine = ("--engine", "ray")


class StoreScorer(Scorer):
    """The same, reading from an object store."""

    name = "scorer, traces in an object store"

    def __init__(self, source: Path, store: Between) -> None:
        super().__init__(source)
        self.store, self.traces = store, upload(source, store, "source")

    def go(self, folder: Path, commit: Commit) -> int:
        """Start like ``Scorer``, with the address of the store."""
        os.environ |= {
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_ENDPOINT_URL": self.store.url,
            "AWS_REGION": "us-east-1",
        }
        return super().go(folder, commit)


def main_with(words: list[str]) -> int:
    """``safestage`` with these words, in this process."""
    sys.argv = ["safestage", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def prepared(folder: Path) -> Path:
    """The episodes to copy and to score, in both formats."""
    source = folder / "source"
    shutil.rmtree(source, ignore_errors=True)
    for i, name in enumerate(names()):
        episode = recording(name).episode()
        save(episode, source / "dataset" if i % 2 else source / f"{name}.mcap")
    return source


def writers(source: Path) -> list[Victim]:
    """All but the scorer, whose processes take long to start."""
    return [
        Recorder(source, "parquet"),
        Recorder(source, "mcap"),
        Command(source, "converter to Parquet", "convert", "{source}", "--to", "parquet", "-o", "{out}"),
        Command(
            source, "converter to MCAP", "convert", "{source}", "--to", "mcap", "--no-events",
            "--force", "-o", "{out}",
        ),
        Command(
            source, "packer", "pack", "{source}", "--out", "{out}", "--by", "task",
            "--shard-episodes", "2",
        ),
        Importer(source),
    ]  # fmt: skip
