"""Map files: facts about bodies and episodes that a source lacks (docs/import/map.md)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from safestage_eval.errors import InputError, did_you_mean
from safestage_eval.rules.diagnostic import Diagnostic, RuleErrors, rendered
from safestage_eval.rules.files import read_toml
from safestage_eval.rules.locate import Locations

from .map_tables import (
    BodyColumns,
    BodyTable,
    CavityTable,
    ColumnsTable,
    HeaderTable,
    InTable,
    MapFile,
    RobotTable,
    ShapeTable,
    SourceTable,
    TcpTable,
)


class MapErrors(InputError):  # noqa: N818 — it holds many
    """A map file that cannot be used, with everything that is wrong with it."""

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        """Sort the diagnostics."""
        self.diagnostics = sorted(diagnostics)
        count = len(diagnostics)
        super().__init__(
            where=self.diagnostics[0].path,
            what=f"{count} problem{'s' if count != 1 else ''} in the map file.",
            fix="see docs/import/map.md",
        )
        self.args = (self.diagnostics,)

    def __str__(self) -> str:
        """Every diagnostic as rendered, then their number."""
        return "\n\n".join([*rendered(self.diagnostics), super().__str__()])


def load_map(path: str | Path) -> MapFile:
    """Read and check a map file.

    Raises:
        MapErrors: with every problem at once, each with its line.
        InputError: it cannot be opened.
    """
    shown = str(path)
    try:
        text, table = read_toml(Path(path), shown)
    except OSError as error:
        raise InputError(shown, f"cannot be read: {error.strerror}.") from None
    except RuleErrors as error:
        raise MapErrors([replace(one, code="M101") for one in error.diagnostics]) from None
    tables = dict(table)
    try:
        if "path" in tables:
            tables["path "] = tables.pop("path")  # no table of the file
        return MapFile.model_validate({**tables, "path": shown})
    except ValidationError as error:
        where = Locations(text)
        raise MapErrors(
            [_to_diagnostic(problem, shown, where) for problem in error.errors()]
        ) from None


def _to_diagnostic(problem: Any, path: str, where: Locations) -> Diagnostic:
    """Locate a problem of pydantic's in the file."""
    keys = tuple(part for part in problem["loc"] if isinstance(part, str | int))
    unknown = problem["type"] == "extra_forbidden"
    spot = where.key(keys) if unknown else where.value(keys)
    if unknown:
        allowed = _allowed(keys[:-1])
        table = ".".join(map(str, keys[:-1])) or "a map file"
        message = f'"{str(keys[-1]).strip()}" is no entry of {table}'
        fix = did_you_mean(str(keys[-1]), allowed)
        return _diagnostic(path, where, spot, "M201", message, ", ".join(allowed), fix)
    message = problem["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    if message != problem["msg"] and not problem["msg"].startswith("Value error"):
        message = f"should be {message}"
    return _diagnostic(path, where, spot, "M202", f"{keys[-1]}: {message}")


def _diagnostic(
    path: str,
    where: Locations,
    spot: Any,
    code: str,
    message: str,
    allowed: str = "",
    fix: str = "",
) -> Diagnostic:
    line = where.line(spot.line)
    return Diagnostic(path, spot.line, spot.column, code, message, allowed, fix, line, spot.length)


_TABLES: dict[str, type[BaseModel]] = {
    "source": SourceTable,
    "every": HeaderTable,
    "task": HeaderTable,
    "episode": HeaderTable,
    "body": BodyTable,
    "columns": ColumnsTable,
    "robot": RobotTable,
    "shapes": ShapeTable,
    "cavity": CavityTable,
    "tcp": TcpTable,
}


def _allowed(keys: tuple[str | int, ...]) -> list[str]:
    """Entries of the table at a path of keys."""
    if not keys:
        return [
            field.alias or name for name, field in MapFile.model_fields.items() if name != "path"
        ]
    if keys[0] == "in":
        return _allowed(keys[2:]) if len(keys) > 2 else list(InTable.model_fields)
    inner = [key for key in keys[2:] if key in _TABLES]
    table = _TABLES[str(inner[-1])] if inner else _TABLES[str(keys[0])]
    if keys[:2] == ("columns", "body"):
        table = BodyColumns
    return list(table.model_fields)
