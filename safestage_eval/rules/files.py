"""Finding and reading rule files: by path, by folder, by built-in name, and through ``extends``."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from safestage_eval._text.toml_text import NumberError, from_toml
from safestage_eval.errors import RuleError, did_you_mean
from safestage_eval.units import FINITE

from .diagnostic import Diagnostic, RuleErrors
from .locate import Keys, Locations, Spot

BENCHMARKS = "benchmarks"
"""Sub-folder of the built-in rule files that no folder and no default takes in."""


@dataclass(frozen=True)
class RuleFile:
    """One rule file as read.

    Attributes:
        path: where it is, as messages say it.
        text: its characters.
        table: its content as TOML; shared by all who read the same text, so not to be changed.
        asked: it was named itself, not merely extended: its rules are judged.
        extends: paths of the files that it extends, directly or through others.
    """

    path: str
    text: str
    table: dict[str, Any] = field(compare=False)
    asked: bool
    extends: frozenset[str] = frozenset()

    @property
    def locations(self) -> Locations:
        """Line and column of each key and value."""
        return _locations(self.text)

    def diagnostic(
        self,
        code: str,
        keys: Keys,
        what: str,
        allowed: str = "",
        fix: str = "",
        *,
        key: bool,
        within: tuple[int, int] | None = None,
    ) -> Diagnostic:
        """A problem at an entry: at its key, or at its value; ``within``: character and length in its string."""
        spot = self.locations.key(keys) if key else self.locations.value(keys)
        if within is not None:
            spot = self.locations.part(spot, *within)
        line, cut = self.locations.around(spot)
        return Diagnostic(
            self.path, spot.line, spot.column, code, what, allowed, fix, line, spot.length, cut
        )


_FILES = 64
"""Texts of rule files that stay parsed."""


@lru_cache(_FILES)
def _parse(text: str) -> dict[str, Any]:
    """The table of a text. Raises as ``from_toml``."""
    return from_toml(text)


@lru_cache(_FILES)
def _locations(text: str) -> Locations:
    return Locations(text)


def builtin_folder() -> Path:
    """Where the built-in rule files are: in an installed package, or in a checkout."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "_builtin" / "rules"
    return installed if installed.is_dir() else package.parent / "rules"


def builtin_names() -> list[str]:
    """Names of SafeStage's own rule files, the default set: ``fsh`` for ``fsh.toml``."""
    return [path.stem for path in _in_folder(builtin_folder())]


def benchmark_names() -> list[str]:
    """Names of the rule files that ask other benchmarks' questions; read only when named."""
    return sorted(path.stem for path in (builtin_folder() / BENCHMARKS).glob("*.toml"))


def on_demand_names() -> list[str]:
    """Names of SafeStage's own rule files that are read only when named: ``robot``."""
    return sorted({path.stem for path in builtin_folder().glob("*.toml")} - {*builtin_names()})


def all_names() -> list[str]:
    """Names of all rule files that come along."""
    return [*builtin_names(), *on_demand_names(), *benchmark_names()]


def find(spec: str | Path) -> list[Path]:
    """The files that a path, a folder or a built-in name stands for.

    A folder without rule files does not stand in a built-in's way: episodes may lie in ``fsh``.

    Raises:
        RuleError: there is none.
    """
    path = Path(spec)
    paths = _in_folder(path) if path.is_dir() else [path] * path.is_file()
    if paths:
        return paths
    builtin = _builtin(str(spec))
    if builtin is not None:
        return [builtin]
    if path.is_dir():
        raise RuleError(str(spec), "the folder has no rule files.", "files ending in .toml")
    raise RuleError(
        str(spec),
        "no such rule file.",
        f"a file, a folder, or a built-in name: {', '.join(all_names())}",
        did_you_mean(str(spec), all_names()),
    )


def _in_folder(folder: Path) -> list[Path]:
    """Its rule files, but for those that say that they are judged only where they are named."""
    return [path for path in sorted(folder.glob("*.toml")) if not _on_demand(path)]


def _on_demand(path: Path) -> bool:
    try:
        head = _parse(path.read_text(encoding="utf-8")).get("ruleset")
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, NumberError):
        return False  # whoever reads it says what is wrong
    return isinstance(head, dict) and head.get("on_demand") is True


def read_files(specs: Sequence[str | Path]) -> tuple[list[RuleFile], list[Diagnostic]]:
    """All files that the specs name and those they extend, the extended ones first.

    What is not TOML, or extends what is not there, comes back as diagnostics.

    Raises:
        RuleError: a spec stands for no file, or a file cannot be opened.
    """
    named = list(dict.fromkeys(path.resolve() for spec in specs for path in find(spec)))
    files: dict[Path, RuleFile] = {}
    broken: dict[Path, list[Diagnostic]] = {}

    def visit(path: Path, trail: tuple[Path, ...]) -> frozenset[str]:
        """Read a file after those it extends; returns its path and theirs."""
        if path not in files and path not in broken:
            broken[path] = []
            shown = _shown(path)
            try:
                file = RuleFile(shown, *read_toml(path, shown), path in named)
            except RuleErrors as error:
                broken[path] += error.diagnostics
                return frozenset()
            except OSError as error:
                raise RuleError(shown, f"cannot be read: {error.strerror}.") from None
            bases: frozenset[str] = frozenset()
            head = file.table.get("ruleset")
            extends = head.get("extends") if isinstance(head, dict) else None
            for index, name in enumerate(extends if isinstance(extends, list) else ()):
                base = _base(path, str(name))
                if base is not None and base not in (*trail, path):
                    bases |= visit(base, (*trail, path))
                    continue
                what, allowed, fix = _no_base(path, str(name), base, trail)
                keys = ("ruleset", "extends", index)
                broken[path].append(file.diagnostic("R104", keys, what, allowed, fix, key=False))
            files[path] = replace(file, extends=bases)
        done = files.get(path)
        return frozenset() if done is None else done.extends | {done.path}

    for path in named:
        visit(path, ())
    return list(files.values()), [problem for problems in broken.values() for problem in problems]


def _no_base(
    path: Path, name: str, base: Path | None, trail: tuple[Path, ...]
) -> tuple[str, str, str]:
    """Why a file cannot extend another, what would do, and the fix."""
    if base is not None:
        circle = " → ".join(one.name for one in (*trail, path, base))
        return f"rule files extend each other in a circle: {circle}", "", ""
    beside = sorted(one.name for one in path.parent.glob("*.toml"))
    allowed = f"a file beside it, or a built-in name: {', '.join(builtin_names())}"
    fix = did_you_mean(name, [*builtin_names(), *beside])
    return f'it extends "{name}", which is not there', allowed, fix


def codes_of(specs: Sequence[str | Path]) -> frozenset[str]:
    """Codes of the rules and costs in the files that the specs name, not in those they extend."""
    return frozenset(
        entry["code"]
        for file in (read_files(specs)[0] if specs else ())
        if file.asked
        for kind in ("rule", "cost")
        for entry in file.table.get(kind, ())
    )


def read_toml(path: Path, shown: str) -> tuple[str, dict[str, Any]]:
    """Text and table of a TOML file; the table is shared by all who read the same text.

    Raises:
        RuleErrors: it is no TOML; ``shown`` is its path in the message.
        OSError: it cannot be opened.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        what = f"not UTF-8 text: {error.reason} at byte {error.start}"
        raise RuleErrors([Diagnostic(shown, 1, 1, "R101", what)]) from None
    return parsed(text, shown)


def parsed(text: str, shown: str) -> tuple[str, dict[str, Any]]:
    """A text and its table. Raises RuleErrors as ``read_toml``."""
    try:
        return text, _parse(text)
    except NumberError as error:
        line, cut = _locations(text).around(Spot(error.line, error.column, 1))
        problem = Diagnostic(
            shown, error.line, error.column, "R102", error.what, FINITE, "write the value that is meant",
            line, 1, cut,
        )  # fmt: skip
    except tomllib.TOMLDecodeError as error:
        problem = _not_toml(shown, text, str(error))
    except RecursionError:
        what = "not readable: lists or tables are nested far too deeply"
        problem = Diagnostic(shown, 1, 1, "R102", what)
    raise RuleErrors([problem])


def _not_toml(shown: str, text: str, message: str) -> Diagnostic:
    """The problem that the TOML parser reports, at the place that it names."""
    match = re.fullmatch(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", message)
    lines = text.split("\n")
    what, line, column = (match[1], match[2], match[3]) if match else (message, None, None)
    number = int(line) if line else len(lines)
    source = lines[number - 1]
    return Diagnostic(
        shown,
        number,
        int(column) if column else len(source) + 1,
        "R102",
        f"not valid TOML: {what[:1].lower()}{what[1:]}",
        source=source,
    )


def _base(path: Path, name: str) -> Path | None:
    try:
        beside = (path.parent / name).resolve()
        if beside.suffix == ".toml" and beside.is_file():
            return beside
    except (OSError, ValueError):  # no file system has such a name
        return None
    return _builtin(name)


def _builtin(name: str) -> Path | None:
    stem = name.removesuffix(".toml")
    if stem in benchmark_names():
        return builtin_folder() / BENCHMARKS / f"{stem}.toml"
    return builtin_folder() / f"{stem}.toml" if stem in all_names() else None


def _shown(path: Path) -> str:
    """The path as short as it can be said from here."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
