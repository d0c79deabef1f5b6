"""The importers, and the choice of one for a file. Each is loaded when a file is examined."""

from __future__ import annotations

import importlib
from pathlib import Path

from safestage_eval._process import simulator
from safestage_eval.errors import TraceError
from safestage_eval.formats.discover import find

from .importer import Format, Importer, Refused, SourceError
from .known_files import Unusable, described

OWN = {
    "isaaclab": "isaac_lab",
    "maniskill": "maniskill",
    "calvin": "calvin",
    "lerobot": "lerobot",
    "rlds": "rlds",
    "tf": "transforms",
    "vla-eval": "vla_eval",
    "joints": "joint_table",
}
"""Format → file in this folder, in the order in which they are asked."""

REFUSED: tuple[type[Refused], ...] = (Unusable,)
"""Known formats that cannot be imported, asked last."""

FROM_SIMULATE = ("mujoco",)
"""Formats that need MuJoCo: ``simulate.importers.NAME`` has a class ``IMPORTER``."""

TITLES = {"mujoco": "MuJoCo states (robosuite, robomimic, LIBERO, MimicGen, RoboCasa, MJX)"}
"""Titles of formats whose file may be out of reach."""


def importers() -> dict[str, type[Importer] | str]:
    """Format → its importer, or why it cannot be used here."""
    result: dict[str, type[Importer] | str] = {}
    for name in (*FROM_SIMULATE, *OWN):
        try:
            result[name] = importer(name)
        except SourceError as error:
            result[name] = f"{error.where}: {error.fix or error.what}"
    return result


def importer(name: str) -> type[Importer]:
    """The importer of a format.

    Raises:
        SourceError: there is none of this name, or what it needs is not installed.
    """
    if name in OWN:
        own: type[Importer] = importlib.import_module(f"{__package__}.{OWN[name]}").IMPORTER
        return own
    if name not in FROM_SIMULATE:
        raise SourceError(f"--from {name}", "no such format.", ", ".join((*OWN, *FROM_SIMULATE)))
    missing = simulator.why_not()
    if missing is not None:
        raise SourceError(TITLES[name], "needs the simulator.", fix=missing)
    try:
        module = importlib.import_module(f"{simulator.NAME}.importers.{name}")
    except ModuleNotFoundError as error:
        raise SourceError(TITLES[name], f"cannot be used: {error}.") from None
    theirs: type[Importer] = module.IMPORTER
    return theirs


def recognise(path: Path, only: str | None = None) -> tuple[str, str] | None:
    """Return the format of a file or folder and the reason; None if it has none that is known.

    Args:
        path: the file or folder.
        only: a format to take it for, instead of trying all.

    Raises:
        SourceError: it is damaged, of a format that cannot be imported, or ``only`` cannot be used.
    """
    if only is not None:
        formats: list[type[Format]] = [importer(only)]
    else:
        formats = [kind for kind in importers().values() if not isinstance(kind, str)]
        formats += REFUSED
    problem = None
    for kind in formats:
        try:
            reason = kind.recognise(path)
        except SourceError as error:
            problem = error
            continue
        if reason is not None and issubclass(kind, Refused):
            raise kind.refusal(path)
        if reason is not None and issubclass(kind, Importer):
            return kind.name, reason
    if problem is not None:
        raise problem
    return None


def _is_trace(source: Path) -> bool:
    try:
        return any(ref.problem is None for ref in find([source]))
    except TraceError:
        return False


def unrecognised(source: Path, only: str | None) -> SourceError:
    """Return the error for a path under which nothing has a known format."""
    if _is_trace(source):
        return SourceError(
            str(source), "it is a SafeStage trace, not someone else's.",
            fix="nothing to import: safestage score reads it as it is",
        )  # fmt: skip
    what = described(source) if only is None else None
    if what is not None:
        return what
    every = {only: importer(only)} if only is not None else importers()
    titles = [kind.title for kind in every.values() if not isinstance(kind, str)]
    out_of_reach = [reason for reason in every.values() if isinstance(reason, str)]
    return SourceError(
        str(source),
        "nothing in here is of a known format.",
        "; ".join(titles),
        "leave out --from" if only is not None
        else f"install what else is read: {'; '.join(out_of_reach)}" if out_of_reach
        else "give the file itself, and say with --from what it is",
    )  # fmt: skip
