"""A map file to begin with: what a source has, what it lacks, and guesses in comments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

from safestage_eval._text.printable import printable
from safestage_eval.episode import Body, Episode
from safestage_eval.errors import InputError

from .account import Account
from .column_episode import UnmappedError
from .guess_roles import guess_bodies, guess_roles
from .import_episode import Target
from .import_source import recognised_in
from .importer import Settings, SourceError
from .read_source import Apart, Limits
from .registry import importer, unrecognised
from .toml_lines import guess_line, toml_key

TASKS = 8
"""Files at the most that are looked into."""

COLUMN = 44
"""Characters of a line before its comment."""


def map_skeleton(source: Path, settings: Settings | None = None, *, only: str | None = None) -> str:
    """The text of a map file for a source, by the first episode of each of its first files.

    What the source says stands there, what it lacks and what is guessed is commented out.

    Args:
        source: a file or folder.
        settings: what is known already.
        only: the format to take it for, instead of asking all.

    Raises:
        SourceError: nothing in it is of a known format, or none of it can be read.
    """
    noted: list[SourceError] = []
    settings = replace(settings or Settings(), noted=noted)
    episodes: list[Episode] = []
    columns: list[str] = []
    failure: InputError | None = None
    if not source.exists():
        raise SourceError(str(source), "no such file or folder", fix="check the spelling")
    with Apart(Target(Path(), False, settings), Limits(), 1) as reading:
        sources = list(islice(recognised_in(source, Path(), reading, only), TASKS))
    for path, kind in sources:
        if isinstance(kind, InputError):
            failure = kind
            continue
        try:
            opened = importer(kind[0])(path, settings)
        except SourceError as error:
            columns += error.columns if isinstance(error, UnmappedError) else ()
            failure = error
            continue
        try:
            episodes.append(opened.read(opened.episodes()[0], Account()))
        except (InputError, IndexError) as error:
            failure = error if isinstance(error, InputError) else failure
        finally:
            opened.close()
    if not sources:
        raise unrecognised(source, only)
    if not episodes and not columns and failure is not None:
        raise failure
    return "\n".join(_lines(source, episodes, columns, noted)) + "\n"


def _lines(
    source: Path, episodes: list[Episode], columns: list[str], noted: list[SourceError]
) -> Iterator[str]:
    yield f"# Map file for {printable(source.name)} (docs/import/map.md). Complete it, then:"
    yield f"#   safestage import {printable(str(source))} --to dataset/ --map THIS_FILE"
    yield "# What is commented out is guessed, or waits for a value: correct it and take the # away."
    missing = dict.fromkeys(f"{error.what} {error.fix}" for error in noted)
    for line in missing:
        yield f"# Missing: {printable(' '.join(line.split()))}"
    yield ""
    yield "[source]"
    yield '# quaternion = "xyzw"  # order of its quaternions, if not w, x, y, z'
    yield '# dt = "50 ms"  # between its rows, if it does not say'
    if columns:
        yield from _columns(columns)
        return
    yield ""
    yield "[every]"
    roles = guess_roles(episodes)
    for role, guess in roles.items():
        yield guess_line(f"# roles.{toml_key(role)}", guess, COLUMN)
    if not roles:
        yield '# roles.target = "…"  # the body that the task is about'
    if not any(episode.header.success is not None for episode in episodes):
        yield "# success = true  # of each episode, under [episode.NAME], with success_time"
    guesses = guess_bodies(episodes)
    bodies = {body.name: body for episode in episodes for body in episode.header.bodies}
    for name, body in bodies.items():
        yield ""
        yield f"[body.{toml_key(name)}]"
        yield f'kind = "{body.kind}"'
        yield from _body(body)
        for key, guess in guesses.get(name, {}).items():
            yield guess_line(f"# {key}", guess, COLUMN)


def _body(body: Body) -> Iterator[str]:
    if body.kind in ("object", "fixture") and not body.geoms:
        yield '# shapes = [{ kind = "box", size = ["2 cm", "2 cm", "2 cm"] }]  # half extents; none in the source'
    if body.kind == "object" and body.mass is None:
        yield "# mass = 0.1  # kg"
    if "cavity" in body.untold:
        yield "# cavity = false  # or the room inside it"
    if "links" in body.untold:
        yield "# its links are not recorded: --robot FILE places them, from its URDF or MJCF"


def _columns(columns: list[str]) -> Iterator[str]:
    yield ""
    yield "[columns]"
    for part in ("action", "joint_position", "success"):
        near = [c for c in columns if part.split("_", maxsplit=1)[0] in c]
        yield f'# {part} = "{near[0] if near else columns[0]}"'
    yield f"# columns of the source: {printable(', '.join(columns))}"
    yield ""
    yield "[columns.body.NAME]"
    yield f'position = "{columns[0].partition("[")[0]}[0:3]"'
    yield f'orientation = "{columns[0].partition("[")[0]}[3:7]"'
