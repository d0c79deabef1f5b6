"""What commands write to: outputs that would destroy something are refused before any work.

An option whose type is ``Output`` names something that is written. All arguments of the same command,
and its options whose type is ``click.Path``, name what is read.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

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

_ALSO_JSON = ("sarif",)
"""Formats that a name ending in .json says as well."""

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


class _Read(NamedTuple):
    """A file or folder that a command reads."""

    option: str
    path: Path
    status: os.stat_result


def refusing_outputs(callback: Callable[..., Any]) -> Callable[..., Any]:
    """A command that first looks at its outputs, and takes ``--format`` from the ending of its ``--output``.

    Raises InputError for an output that is something that is read or written already (links are
    followed), that lies in a dataset, is a recording, or has an ending of another format.
    """

    @wraps(callback)
    def run(*arguments: Any, **given: Any) -> Any:
        ctx = click.get_current_context()
        named = [
            (param.opts[0], path, param.type)
            for param in ctx.command.params
            if isinstance(param.type, Output)
            and (path := ctx.params.get(param.name or "")) is not None
            and (not param.type.when or ctx.params[param.type.when])
        ]
        if "form" in given and (formats := _formats(ctx)):
            for _, path, kind in named:
                if not kind.formats and not kind.folder:
                    given["form"] = ctx.params["form"] = _form(ctx, path, formats)
        read, written = list(_read(ctx)), list[tuple[str, Path]]()
        for option, path, kind in named:
            meant = FORMAT_OF.get(path.suffix.lower())
            if kind.formats and meant is not None and meant not in kind.formats:
                raise InputError(f"{option} {path}", *_cannot_write(path, kind.formats))
            for each in [path, *kind.beside(path, ctx.params)]:
                if why := _why_not(each, kind, read, written):
                    raise InputError(f"{option} {each}", why[0], fix=why[1])
                written.append((option, each))
        return callback(*arguments, **given)

    return run


def _formats(ctx: click.Context) -> list[str]:
    """The choices of ``--format``."""
    options = (param.type for param in ctx.command.params if param.name == "form")
    return [
        str(name) for kind in options if isinstance(kind, click.Choice) for name in kind.choices
    ]


def _form(ctx: click.Context, output: Path, formats: list[str]) -> str:
    """The format of an output: that of its ending, where it has one that says it."""
    given: str = ctx.params["form"]
    meant = FORMAT_OF.get(output.suffix.lower())
    if meant is None:
        return given
    chosen = ctx.get_parameter_source("form") is not ParameterSource.DEFAULT
    if meant == given or (chosen and meant == "json" and given in _ALSO_JSON):
        return given
    if chosen:
        raise InputError(
            f"--output {output}", f"--format {given} contradicts the ending {output.suffix.lower()}.",
            fix="leave out one of the two",
        )  # fmt: skip
    if meant not in formats:
        raise InputError(f"--output {output}", *_cannot_write(output, formats))
    return meant


def _cannot_write(path: Path, formats: Any) -> tuple[str, str, str]:
    allowed = [ending for ending, form in FORMAT_OF.items() if form in formats]
    what = f"this command cannot write {path.suffix.lower()}."
    fix = "safestage report writes pages" if FORMAT_OF[path.suffix.lower()] == "html" else ""
    return what, f"names ending in {', '.join(allowed)}", fix


def _read(ctx: click.Context) -> Iterator[_Read]:
    """What is there of all that a command is told to read."""
    for param in ctx.command.params:
        value = ctx.params.get(param.name or "")
        if isinstance(param.type, Output):
            if not param.type.when or ctx.params[param.type.when]:
                continue
        elif not isinstance(param, click.Argument) and not isinstance(param.type, click.Path):
            continue
        for each in value if isinstance(value, tuple | list) else [value]:
            if isinstance(each, str | Path) and (status := _status(Path(each))):
                name = param.opts[0] if isinstance(param, click.Option) else ""
                yield _Read(f"{name} {each}".strip(), Path(os.path.realpath(each)), status)
                yield from _rule_files(name, Path(each))


def _rule_files(option: str, folder: Path) -> Iterator[_Read]:
    if option in ("--rules", "--against") and folder.is_dir():
        for file in folder.rglob("*.toml"):
            if status := _status(file):
                yield _Read(f"{option} {folder}", Path(os.path.realpath(file)), status)


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except (OSError, ValueError):
        return None


def _why_not(
    path: Path, kind: Output, read: list[_Read], written: list[tuple[str, Path]]
) -> tuple[str, str] | None:
    """Why an output is refused, and what to do instead; None if it may be written."""
    from safestage_eval.formats.atomic import is_stream

    another = "name another file" if kind.file else "name another folder"
    if is_stream(path):
        if kind.stream:
            return None
        return "is neither a file nor a folder.", another
    real, status = Path(os.path.realpath(path)), _status(path)
    if status and path.is_dir() and not kind.folder:
        return "is a folder.", "name a file"
    if status and not path.is_dir() and not kind.file:
        return "is a file.", "name a folder"
    above = next((folder for folder in real.parents if folder.exists()), None)
    if above is not None and not above.is_dir():
        return f"{above} is a file, and cannot hold another.", another
    for option, other in written:
        if Path(os.path.realpath(other)) == real or (status and _same(status, _status(other))):
            return f"is also the file of {option}: one of the two would be lost.", another
    for each in read:
        if status and not path.is_dir() and _same(status, each.status):
            return f"is a file that this command reads ({each.option}).", another
        if kind.emptied and real in each.path.parents:
            return f"holds what this command reads ({each.option}).", another
    for folder in (real, *real.parents):
        if why := _in_dataset(real, folder, kind, read):
            return why, another + " outside of it"
    if status and path.is_file() and "mcap" not in kind.formats and _is_recording(path):
        return "is a recording, which would be lost.", another
    return None


def _same(one: os.stat_result, other: os.stat_result | None) -> bool:
    return other is not None and os.path.samestat(one, other)


def _in_dataset(real: Path, dataset: Path, kind: Output, read: list[_Read]) -> str:
    """Why nothing may be written there, where a folder above it is a dataset; empty if it may."""
    from safestage_eval.formats.parquet.dataset_layout import ASSETS, TABLE_FOLDERS, is_dataset

    if not is_dataset(dataset):
        return ""
    own = [dataset / name for name in ("meta", ASSETS, *TABLE_FOLDERS)]
    page = kind.file and (not kind.folder or real.suffix.lower() in FORMAT_OF)
    if page and any(folder in real.parents for folder in own):
        return f"lies among the tables of the dataset {dataset}."
    for each in read if not kind.in_dataset else ():
        above = dataset == each.path or (each.path in dataset.parents and real != dataset)
        if above or any(folder in each.path.parents for folder in own):
            return f"is or lies in a dataset that this command reads ({each.option})."
    return ""


def _is_recording(path: Path) -> bool:
    from safestage_eval.formats.discover import MCAP_MAGIC
    from safestage_eval.formats.zip_reader import is_zip_trace

    with path.open("rb") as file:
        head = file.read(64)
    return head.startswith(MCAP_MAGIC) or is_zip_trace(head)
