"""Rule files: found by path, folder or built-in name; read, checked and merged into one rule set."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safestage_eval.errors import RuleError

from . import build, parse
from . import syntax as ast

DEFINITIONS = ("param", "material", "signal", "state", "phase", "goal", "family", "task")
"""The tables whose entries are named, may be used by other files and may be overridden."""


@dataclass(frozen=True)
class RuleFile:
    """One rule file as read.

    Attributes:
        path: where it is.
        text: its characters.
        table: what TOML makes of them.
        asked: it was asked for, not merely extended: its rules are judged.
    """

    path: str
    text: str
    table: dict[str, Any]
    asked: bool


def builtin_folder() -> Path:
    """Where the built-in rule files are: in an installed package, or in a checkout."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "_builtin" / "rules"
    return installed if installed.is_dir() else package.parent / "rules"


def builtin_names() -> list[str]:
    """Names that stand for built-in rule files: ``fsh`` for ``fsh.toml``."""
    return sorted(path.stem for path in builtin_folder().glob("*.toml"))


def find(spec: str | Path) -> list[Path]:
    """The files that a path, a folder or a built-in name stands for.

    Raises RuleError when there is none.
    """
    path = Path(spec)
    if path.is_dir():
        found = sorted(path.glob("*.toml"))
        if not found:
            raise RuleError(str(spec), "the folder has no rule files.", "files ending in .toml")
        return found
    if path.is_file():
        return [path]
    if str(spec) in builtin_names():
        return [builtin_folder() / f"{spec}.toml"]
    raise RuleError(
        str(spec),
        "no such rule file.",
        f"a file, a folder, or a built-in name: {', '.join(builtin_names())}",
    )


def read_files(specs: Sequence[str | Path]) -> list[RuleFile]:
    """All files that the specs name and those they extend, the extended ones first.

    Raises RuleError for what is missing, is not TOML, or extends itself.
    """
    files: dict[Path, RuleFile] = {}
    asked = [path.resolve() for spec in specs for path in find(spec)]

    def visit(path: Path, trail: tuple[Path, ...]) -> None:
        if path in trail:
            circle = " → ".join(p.name for p in (*trail, path))
            raise RuleError(str(path), f"rule files extend each other in a circle: {circle}")
        if path in files:
            return
        shown = _shown(path)
        try:
            text = path.read_text(encoding="utf-8")
            table = tomllib.loads(text)
        except UnicodeDecodeError as error:
            raise RuleError(
                shown, f"not UTF-8 text: {error.reason} at byte {error.start}"
            ) from None
        except tomllib.TOMLDecodeError as error:
            raise RuleError(shown, f"not valid TOML: {error}") from None
        head = table.get("ruleset", {})
        extends = head.get("extends", []) if isinstance(head, dict) else []
        for name in extends if isinstance(extends, list) else []:
            base = (path.parent / str(name)).resolve()
            if not base.is_file():
                raise RuleError(shown, f"extends {name!r}, which is not there", str(base.parent))
            visit(base, (*trail, path))
        files[path] = RuleFile(shown, text, table, path in asked)

    for path in asked:
        visit(path, ())
    return list(files.values())


def load_rules(specs: Sequence[str | Path]) -> ast.RuleSet:
    """Read, check and merge rule files.

    Args:
        specs: paths of files or folders, or built-in names (``["fsh"]``, ``["rules/"]``).

    Raises:
        RuleErrors: with every diagnostic of every file at once.
        RuleError: a file is missing or is not TOML.
    """
    return merge(read_files(specs))


def merge(files: Sequence[RuleFile]) -> ast.RuleSet:
    """One rule set of checked files; a later definition of a name replaces an earlier one."""
    tables: dict[str, dict[str, Any]] = {kind: {} for kind in DEFINITIONS}
    baseline = "first 5 frames of episode"
    for file in files:
        for kind in DEFINITIONS:
            for name, value in file.table.get(kind, {}).items():
                before = tables[kind].get(name, {}) if kind == "material" else None
                tables[kind][name] = value if before is None else {**before, **value}
        baseline = file.table.get("baseline", {}).get("span", baseline)
    builder = build.Builder(frozenset(tables["phase"]))
    asked = [file for file in files if file.asked]
    rules = [builder.rule(t, f.path, 0) for f in asked for t in f.table.get("rule", ())]
    costs = [builder.cost(t, f.path, 0) for f in asked for t in f.table.get("cost", ())]
    heads = [file.table["ruleset"] for file in asked]
    return ast.RuleSet(
        name="+".join(head["name"] for head in heads),
        version="+".join(dict.fromkeys(str(head["version"]) for head in heads)),
        baseline=builder.span(baseline),
        params={name: parse.setting(value) for name, value in tables["param"].items()},
        materials={
            name: {column: parse.quantity(value) for column, value in row.items()}
            for name, row in {"default": {}, **tables["material"]}.items()
        },
        signals={
            name: ast.SignalDef(
                name, t["base"], tuple(sorted((k, v) for k, v in t.items() if k != "base"))
            )
            for name, t in tables["signal"].items()
        },
        states={name: builder.state(name, t) for name, t in tables["state"].items()},
        phases={name: builder.phase(name, t) for name, t in tables["phase"].items()},
        goals={name: builder.goal(name, t) for name, t in tables["goal"].items()},
        families={name: build.family(name, t) for name, t in tables["family"].items()},
        tasks={name: build.task(name, t) for name, t in tables["task"].items()},
        rules={rule.code: rule for rule in rules},
        costs={cost.code: cost for cost in costs},
    )


def _shown(path: Path) -> str:
    """The path as short as it can be said from here."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
