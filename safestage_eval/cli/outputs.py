"""What commands write to: outputs that would destroy something are refused before any work.

An option whose type is ``Output`` names something that is written. All arguments of the same command,
and its options whose type is ``click.Path``, name what is read.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from safestage_eval.errors import InputError

FORMAT_OF = {
    ".json": "json", ".jsonl": "jsonl", ".csv": "csv", ".parquet": "parquet", ".md": "markdown",
    ".xml": "junit", ".sarif": "sarif", ".tex": "latex", ".html": "html", ".htm": "html",
    ".toml": "toml", ".onnx": "onnx", ".mcap": "mcap", ".zip": "zip", ".rrd": "rrd", ".png": "png",
    ".svg": "svg", ".pdf": "pdf", ".mp4": "mp4", ".gif": "gif", ".webp": "webp",
}  # fmt: skip
"""Endings that say what a file is. Under any other one a file may be anything."""

STDOUT = Path("/dev/stdout")


class Output(click.Path):
    """Type of an option that names what the command writes; ``-`` is stdout.

    Attributes:
        formats: of the file, by names of ``FORMAT_OF``; those of ``--format`` if empty.
        file, folder: what it may be.
        stream: whether it may be a device or pipe as well.
        emptied: the folder is emptied first, so nothing that is read may lie in it.
        in_dataset: it may lie in a dataset that is read, beside its tables.
        when: the option without which the file is only read.
        beside: from the file and the command's parameters, what else is written.
    """

    def __init__(
        self,
        *formats: str,
        file: bool = True,
        folder: bool = False,
        stream: bool = True,
        emptied: bool = False,
        in_dataset: bool = False,
        when: str = "",
        beside: Callable[[Path, dict[str, Any]], list[Path]] = lambda _path, _given: [],
    ) -> None:
        super().__init__(path_type=Path, file_okay=file, dir_okay=folder)
        self.formats = formats
        self.file, self.folder, self.stream = file, folder, stream and file
        self.emptied, self.in_dataset = emptied, in_dataset
        self.when, self.beside = when, beside

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:  # noqa: ARG002
        """The path; what it is, is looked at by ``refusing_outputs``."""
        return STDOUT if value == "-" and self.stream else Path(value)


def written(data: str | bytes | Iterable[str | bytes], output: Path | None) -> None:
    """Write data to stdout, or to an output as ``formats.atomic.writing``; at once or piece by piece."""
    pieces = [data] if isinstance(data, str | bytes) else data
    if output in (None, STDOUT):
        for piece in pieces:
            click.echo(piece, nl=False)
        return
    from safestage_eval.formats.atomic import writing

    try:
        with writing(output) as temporary, temporary.open("wb") as stream:
            for piece in pieces:
                stream.write(piece.encode() if isinstance(piece, str) else piece)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise click.UsageError(f"--output {output}: {error.strerror}") from None


def refusing_outputs(callback: Callable[..., Any]) -> Callable[..., Any]:
    """A command that first looks at its outputs, and takes ``--format`` from the ending of its ``--output``.

    Raises InputError for an output that is something that is read or written already (links are
    followed), that lies in a dataset, is a recording, or has an ending of another format.
    """

    @wraps(callback)
    def run(*arguments: Any, **given: Any) -> Any:
        ctx = click.get_current_context()
        outputs = [
            (param.opts[0], path, param.type)
            for param in ctx.command.params
            if isinstance(param.type, Output) and (path := ctx.params[param.name or ""]) is not None
            if not param.type.when or ctx.params[param.type.when]
        ]
        offered = next((p.type for p in ctx.command.params if p.name == "form"), None)
        taken = [*_read(ctx)]
        for option, path, kind in outputs:
            formats = kind.formats
            if not formats and not kind.folder and isinstance(offered, click.Choice):
                given["form"] = ctx.params["form"] = _form(ctx, path)
                formats = tuple(map(str, offered.choices))
            _check_ending(option, path, formats)
            for each in [path, *kind.beside(path, ctx.params)]:
                if why := _why_not(each, kind, taken):
                    raise InputError(f"{option} {each}", *why)
                taken.append((option, each, True))
        return callback(*arguments, **given)

    return run


def _form(ctx: click.Context, output: Path) -> str:
    """The format of an output: that of its ending, where it has one that says it."""
    given: str = ctx.params["form"]
    meant = FORMAT_OF.get(output.suffix.lower(), given)
    if ctx.get_parameter_source("form") is ParameterSource.DEFAULT:
        return meant
    if meant != given and (meant, given) != ("json", "sarif"):
        raise InputError(
            f"--output {output}", f"--format {given} contradicts the ending {output.suffix.lower()}.",
            fix="leave out one of the two",
        )  # fmt: skip
    return given


def _check_ending(option: str, path: Path, formats: Sequence[str]) -> None:
    ending = path.suffix.lower()
    meant = FORMAT_OF.get(ending)
    if meant is None or not formats or meant in formats:
        return
    allowed = [ending for ending, form in FORMAT_OF.items() if form in formats]
    raise InputError(
        f"{option} {path}", f"this command cannot write {ending}.", f"names ending in {', '.join(allowed)}",
        "safestage report writes pages" if meant == "html" else "",
    )  # fmt: skip


Taken = tuple[str, Path, bool]
"""The option and path of something that a command reads, or has said to write (True)."""


def _read(ctx: click.Context) -> Iterator[Taken]:
    """Yield the files that a command reads and that exist; of a folder of rules each file."""
    for param in ctx.command.params:
        value = ctx.params.get(param.name or "")
        if isinstance(param.type, Output):
            if not param.type.when or ctx.params[param.type.when]:
                continue
        elif not isinstance(param, click.Argument) and not isinstance(param.type, click.Path):
            continue
        option = param.opts[0] if isinstance(param, click.Option) else ""
        for each in value if isinstance(value, tuple | list) else [value]:
            if isinstance(each, str | Path) and _status(Path(each)):
                yield f"{option} {each}".strip(), Path(each), False
                if option in ("--rules", "--against") and Path(each).is_dir():
                    yield from (
                        (f"{option} {each}", file, False) for file in Path(each).rglob("*.toml")
                    )


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except (OSError, ValueError):
        return None


def _real(path: Path) -> Path:
    return Path(os.path.realpath(path))


def _why_not(path: Path, kind: Output, taken: Sequence[Taken]) -> tuple[str, str, str] | None:
    """Why an output is refused, what is allowed and what to do instead; None if it may be written."""
    from safestage_eval.formats.atomic import is_stream

    another = "name another file" if kind.file else "name another folder"
    real, status = _real(path), _status(path)
    above = next((folder for folder in real.parents if folder.exists()), real)
    if is_stream(path):
        return None if kind.stream else ("is neither a file nor a folder.", "", another)
    if status and not (kind.folder if path.is_dir() else kind.file):
        return (
            ("is a folder.", "", "name a file")
            if kind.file
            else ("is a file.", "", "name a folder")
        )
    if not above.is_dir():
        return f"{above} is a file, and cannot hold another.", "", another
    for option, other, is_written in taken:
        there = _status(other)
        same = status is not None and there is not None and os.path.samestat(status, there)
        if is_written and (same or _real(other) == real):
            return f"is also the file of {option}: one of the two would be lost.", "", another
        if same and not path.is_dir():
            return f"is a file that this command reads ({option}).", "", another
        if kind.emptied and not is_written and real in _real(other).parents:
            return f"holds what this command reads ({option}).", "", another
    for folder in (real, *real.parents):
        if why := _in_dataset(real, folder, kind, taken):
            return why, "", f"{another} outside of it"
    if status and path.is_file() and "mcap" not in kind.formats and _is_recording(path):
        return "is a recording, which would be lost.", "", another
    return None


def _in_dataset(real: Path, dataset: Path, kind: Output, taken: Sequence[Taken]) -> str:
    """Why nothing may be written there, where a folder above it is a dataset; empty if it may."""
    from safestage_eval.formats.parquet.dataset_layout import ASSETS, TABLE_FOLDERS, is_dataset

    if not is_dataset(dataset):
        return ""
    tables = [dataset / name for name in ("meta", ASSETS, *TABLE_FOLDERS)]
    page = kind.file and (not kind.folder or real.suffix.lower() in FORMAT_OF)
    if page and any(folder in real.parents for folder in tables):
        return f"lies among the tables of the dataset {dataset}."
    for option, path, is_written in () if kind.in_dataset else taken:
        read = _real(path)
        holds = dataset == read or (read in dataset.parents and real != dataset)
        if not is_written and (holds or any(folder in read.parents for folder in tables)):
            return f"is or lies in a dataset that this command reads ({option})."
    return ""


def _is_recording(path: Path) -> bool:
    from safestage_eval.formats.discover import MCAP_MAGIC
    from safestage_eval.formats.zip_reader import is_zip_trace

    with path.open("rb") as file:
        head = file.read(64)
    return head.startswith(MCAP_MAGIC) or is_zip_trace(head)
