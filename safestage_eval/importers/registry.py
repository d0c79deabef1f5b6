"""The importers, and the choice of one for a file. Each is loaded when a file is examined."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from safestage_eval._process import simulator
from safestage_eval.errors import TraceError
from safestage_eval.formats.discover import find

from .importer import Format, Importer, Refused, SourceError
from .stateless import Stateless

OWN = {
    "isaaclab": "isaac_lab",
    "maniskill": "maniskill",
    "lerobot": "lerobot",
    "tf": "transforms",
}
"""Format → file in this folder, in the order in which they are asked."""

REFUSED: tuple[type[Refused], ...] = (Stateless,)
"""Known formats that cannot be imported, asked last."""

FROM_SIMULATE = ("mujoco",)
"""Formats that need MuJoCo: ``simulate.importers.NAME`` has a class ``IMPORTER``."""

TITLES = {"mujoco": "MuJoCo states (robosuite, robomimic, LIBERO, MimicGen, RoboCasa)"}
"""Of the formats whose file may be out of reach."""


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


Claim = tuple[type[Importer] | SourceError, str]
"""The importer of a file or folder with its reason; or why it cannot be examined."""


def recognised(
    source: Path, only: str | None = None, but: Path | None = None
) -> list[tuple[Path, type[Importer] | SourceError, str]]:
    """Each file or folder under a path that an importer takes.

    ``only`` asks one importer alone; the folder ``but`` is left out.

    Raises:
        SourceError: there is none, with what was looked for; or a format that cannot be used.
    """
    kinds = asked(only)
    found = list(walk(source, lambda path: claimed(path, kinds), but))
    if not found:
        raise nothing_known(source, only)
    return [(path, *claim) for path, claim in found]


Found = TypeVar("Found")


def walk(
    source: Path, claim: Callable[[Path], Found | None], but: Path | None = None
) -> Iterator[tuple[Path, Found]]:
    """What ``claim`` says of each file or folder under a path; nothing below one that is claimed.

    The folder ``but`` is left out. Raises SourceError when there is no such path.
    """
    if not source.exists():
        raise SourceError(str(source), "no such file or folder", fix="check the spelling")
    yield from _walk(source, claim, None if but is None else but.resolve())


def _walk(
    source: Path, claim: Callable[[Path], Found | None], but: Path | None
) -> Iterator[tuple[Path, Found]]:
    if source.resolve() == but:
        return
    found = claim(source)
    if found is not None:
        yield source, found
        return
    if source.is_file():
        return
    for path in sorted(source.iterdir()):
        if not path.name.startswith("."):
            yield from _walk(path, claim, but)


def asked(only: str | None = None) -> list[type[Format]]:
    """The formats that are known here, or one importer alone. Raises SourceError if it cannot be used."""
    if only is not None:
        return [importer(only)]
    return [*(kind for kind in importers().values() if not isinstance(kind, str)), *REFUSED]


def claimed(path: Path, kinds: Sequence[type[Format]]) -> Claim | None:
    """Which of the formats a file or folder has; None if none of them."""
    problem = None
    for kind in kinds:
        try:
            reason = kind.recognise(path)
            if reason is not None and issubclass(kind, Refused):
                return kind.refusal(path), reason
        except SourceError as error:
            problem = error
            continue
        if reason is not None and issubclass(kind, Importer):
            return kind, reason
    return None if problem is None else (problem, "")


def _is_trace(source: Path) -> bool:
    try:
        return any(ref.problem is None for ref in find([source]))
    except TraceError:
        return False


def nothing_known(source: Path, only: str | None = None) -> SourceError:
    """That nothing under a path is of a known format, with what was looked for."""
    if _is_trace(source):
        return SourceError(
            str(source), "it is a SafeStage trace, not someone else's.",
            fix="nothing to import: safestage score reads it as it is",
        )  # fmt: skip
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
