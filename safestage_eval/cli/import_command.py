"""``safestage import``."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval.units import LONGEST, finite

from .command_options import argument, option
from .command_options import command as make
from .outputs import Output, written
from .rule_choice import rules_option
from .terminal import progress, say, say_lines, say_problems

if TYPE_CHECKING:
    from collections.abc import Sequence

    from safestage_eval.importers import Outcome, Settings
    from safestage_eval.importers.import_episode import Failed
    from safestage_eval.importers.map_mistakes import Notice

FOLDER = click.Path(path_type=Path, exists=True, file_okay=False)
FILE = click.Path(path_type=Path, exists=True, dir_okay=False)


@make("import")
def command(
    source: Path = argument("SOURCE"),
    to: Path | None = option(
        "Write to this dataset folder; existing episodes are kept.",
        of=Output(file=False, folder=True), metavar="DATASET",
    ),
    map_: Path | None = option(
        "Read what the source lacks from FILE: shapes, masses, tags, roles, success, columns.",
        "--map", metavar="FILE",
    ),
    bind: Path | None = option(
        "Write roles, goal, rules and values of this bind file into the headers.", metavar="FILE"
    ),
    rules: tuple[str, ...] = rules_option,
    only: str | None = option(
        "Read SOURCE as this format. Default: detected from its content.", "--from", metavar="NAME"
    ),
    quaternion: Any = option(
        "Read quaternions in this order, where the source does not say.", of=("wxyz", "xyzw")
    ),
    dt: str | None = option(
        'Take this time between rows, where the source does not say: "50 ms", 0.05, 1/20.',
        metavar="TIME",
    ),
    assets: tuple[Path, ...] = option(
        "Search this folder for mesh files that the source names. Repeatable.", of=FOLDER, metavar="DIR"
    ),
    robot: Path | None = option(
        "Place the robot's links by its recorded joints and this description (URDF or MJCF).",
        of=FILE, metavar="FILE",
    ),
    python: Path | None = option(
        "Compute contacts of MuJoCo states with the mujoco of this Python, the recorder's own.",
        of=FILE, metavar="PATH",
    ),
    prefix: str = option("Begin every episode id with TEXT.", default="", metavar="TEXT"),
    limit: int | None = option("Import only the first N episodes.", least=1, metavar="N"),
    jobs: int = option("Use N worker processes.", "-j", least=1, default=1, metavar="N"),
    timeout: float | None = option(
        "Abort an episode, or a look at a source, after SECONDS and list it as a problem. Default: "
        "120 s plus 2 s per MB.",
        of=click.FloatRange(0, min_open=True), metavar="SECONDS",
    ),
    memory: str | None = option(
        "Abort an episode whose worker exceeds SIZE, such as 800MB or 2GB.", metavar="SIZE"
    ),
    mcap: bool = option("Write one MCAP file per episode instead of a dataset."),
    write_map: Path | None = option(
        "Write a map file to begin with, and import nothing: what SOURCE has and lacks, with guesses.",
        of=Output("toml"), metavar="FILE",
    ),
    replace: bool = option(
        "Import again what the dataset has from other data, or with another map or flags."
    ),
    form: str = option(
        "Write the report as this.", "--format", "-f", of=("table", "json"), default="table"
    ),
) -> int:  # fmt: skip
    """Import other people's recordings, and report what they lack.

    The format is detected from the content. Nothing is invented: what a source lacks stays out, the
    report of every episode lists it, and rules that need it are inconclusive. What cannot be right
    (what nothing bears, what overlaps or rests on an edge) is named with the likely mistake.
    Episodes that the dataset already has are kept; a stopped import continues where it stopped.
    Sources are read in separate processes, which are ended if they hang.

    \b
    Examples:
      safestage import demos.hdf5 --to dataset/
      safestage import runs/ --write-map scene.toml
      safestage import runs/ --to dataset/ --map scene.toml --quaternion xyzw
    """
    from safestage_eval._process.memory_limit import limit as most
    from safestage_eval.importers import MapFile, Settings, import_all, load_map
    from safestage_eval.importers.bind_headers import demand_goals, load_bound
    from safestage_eval.importers.map_mistakes import summed
    from safestage_eval.importers.read_source import Limits

    limits = Limits(timeout, None if memory is None else most(memory))
    settings = Settings(
        map=MapFile() if map_ is None else load_map(map_),
        quaternion=quaternion,
        dt=None if dt is None else _seconds(dt),
        assets=assets,
        robot=None if robot is None else robot.absolute(),
        python=None if python is None else python.absolute(),
    )
    if write_map is not None:
        _write_map(write_map, source, settings, only)
        return 0
    if to is None:
        raise click.UsageError("--to DATASET is missing: the folder to write to")
    bound = None if bind is None else load_bound(bind, rules)
    demand_goals(settings.map, rules)
    with progress("importing") as tell:
        outcome = import_all(
            source, to, settings, only=only, bind=bound, prefix=prefix, limit=limit, jobs=jobs,
            mcap=mcap, replace=replace, limits=limits, progress=tell,
        )  # fmt: skip
    notices = summed(each.notices for each in outcome.imported)
    if form == "json":
        click.echo(_as_json(outcome, notices))
    else:
        say_lines(_as_table(outcome))
    for message in outcome.unused:
        say(f"warning: {message}", err=True)
    total = len(outcome.imported)
    for notice, count in notices:
        say(f"looks wrong in {count} of {total} episodes: {notice}", err=True)
    say_problems(_alike(outcome.failed))
    new = sum(each.new for each in outcome.imported)
    there = f"{new} imported, {total - new} there already"
    say(f"{there}, {len(outcome.failed)} not imported", err=True)
    return 2 if outcome.failed else 0


def _alike(failed: Sequence[Failed]) -> list[str]:
    """Messages of what was not imported; of those that differ by names and numbers the first, with how many."""
    groups: dict[str, list[str]] = {}
    for each in failed:
        path, _, name = each.source.rpartition(":")
        cause = each.message.replace(each.source, "").replace(path or name, "")
        cause = re.sub(rf"\b{re.escape(name)}\b", "", cause)
        groups.setdefault(re.sub(r"\d+([.]\d+)?", "#", cause), []).append(each.message)
    return [
        first + (f" So {'is' if len(more) == 1 else 'are'} {len(more)} more." if more else "")
        for first, *more in groups.values()
    ]


def _write_map(path: Path, source: Path, settings: Settings, only: str | None) -> None:
    """Write a map file to begin with; refuse to overwrite one."""
    from safestage_eval.formats.atomic import is_stream
    from safestage_eval.importers.write_map import map_skeleton

    if path.exists() and not is_stream(path):
        raise click.UsageError(f"--write-map {path}: is there already; choose another name")
    text = map_skeleton(source, settings, only=only)
    written(text, path)
    said = sum(line.startswith("[body.") for line in text.splitlines())
    say(f"{path}: {said} bodies; complete it, then import with --map {path}", err=True)


def _seconds(text: str) -> float:
    """``50 ms``, ``0.05``, ``1/20``, in s."""
    match = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(?:/\s*([0-9.eE+-]+))?\s*(s|ms)?\s*", text)
    try:
        assert match is not None
        value = finite(match[1]) / finite(match[2] or 1) * (1e-3 if match[3] == "ms" else 1)
        assert 0 < value <= LONGEST
    except (AssertionError, ValueError, ZeroDivisionError):
        raise click.UsageError(f'--dt {text}: a time, as "50 ms", 0.05 or 1/20') from None
    return value


def _as_table(outcome: Outcome) -> str:
    """Each episode in a line, then the remarks on all, with how many episodes have each."""
    from safestage_eval._text.printable import printable
    from safestage_eval.importers.account import summed

    lines = [f"{path}: {name} ({why})" for path, (name, why) in outcome.formats.items()]
    for each in outcome.imported:
        state = f"{each.frames} frames" if each.new else "there already"
        kinds = [remark.kind for remark in each.account]
        counts = ", ".join(
            f"{kinds.count(kind)} {kind}" for kind in ("missing", "recomputed", "guessed")
        )
        lines.append(f"{each.episode_id}  {state}  {counts}")
    total = len(outcome.imported)
    for remark, count in summed(each.account for each in outcome.imported):
        lines.append(f"{count} of {total}  {remark}")
    return "".join(f"{printable(line)}\n" for line in lines)


def _as_json(outcome: Outcome, notices: Sequence[tuple[Notice, int]]) -> str:
    from safestage_eval._text.json_out import to_json
    from safestage_eval.importers.account import summed

    accounts = [each.account for each in outcome.imported]
    data = {
        "sources": [
            {"path": path, "format": name, "recognised_by": why}
            for path, (name, why) in outcome.formats.items()
        ],
        "episodes": [
            {
                "episode_id": each.episode_id,
                "source": each.source,
                "path": each.path,
                "frames": each.frames if each.new else None,
                "new": each.new,
                "account": [remark.model_dump() for remark in each.account],
            }
            for each in outcome.imported
        ],
        "summary": [{**remark.model_dump(), "episodes": n} for remark, n in summed(accounts)],
        "looks_wrong": [{**asdict(notice), "episodes": n} for notice, n in notices],
        "problems": [{"source": p.source, "message": p.message} for p in outcome.failed],
    }
    return to_json(data, 2)
