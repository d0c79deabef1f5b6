"""Interface of an importer: recognise files; list their episodes; read one, or refuse."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import Episode
from safestage_eval.errors import InputError

from .account import Account
from .map_tables import MapFile

QuaternionOrder = Literal["wxyz", "xyzw"]


class SourceError(InputError):
    """A source that lacks what no trace can do without; ``fix`` names the flag or file that has it."""


@dataclass(frozen=True)
class Settings:
    """The user's additions to a source. Small and picklable.

    Attributes:
        map: what the map file says (docs/import/map.md).
        quaternion: order of the source's quaternions, where it does not tell.
        dt: s between the source's rows, where it does not tell.
        robot: its description, URDF or MJCF, by which its joints place its links.
        python: interpreter that has the recorder's own MuJoCo.
        noted: receives what the source lacks, for a first look, where it would be refused otherwise.
        assets: folders with the mesh files that a source names but does not bring.
    """

    map: MapFile = field(default_factory=MapFile)
    quaternion: QuaternionOrder | None = None
    dt: float | None = None
    assets: tuple[Path, ...] = ()
    python: Path | None = None
    robot: Path | None = None
    noted: list[SourceError] | None = field(default=None, compare=False)

    @property
    def stated_dt(self) -> float | None:
        """Time in s between rows as the user states it, by flag or map file."""
        return self.dt or self.map.source.dt

    @property
    def stated_order(self) -> QuaternionOrder | None:
        """Order of quaternions as the user states it, by flag or map file."""
        return self.quaternion or self.map.source.quaternion


class Format(ABC):
    """A foreign format."""

    @classmethod
    @abstractmethod
    def recognise(cls, path: Path) -> str | None:
        """Return why this format matches a file or folder; None if it does not.

        Looks at content, never at names alone, and is quick.

        Raises:
            SourceError: the file is damaged, or what reads such files is not installed.
        """


class Refused(Format):
    """A known format that nothing can be imported from."""

    @classmethod
    @abstractmethod
    def refusal(cls, path: Path) -> SourceError:
        """Return the error with what the source lacks, and what to ask its publisher for."""


class Importer(Format):
    """One source: a file or folder of one format, open for reading.

    Subclasses are made in worker processes as well, from the same arguments.
    """

    name: ClassVar[str]
    """Name for ``--from``."""
    title: ClassVar[str]
    """Name in messages."""

    def __init__(self, path: Path, settings: Settings) -> None:
        """Open the source.

        Raises:
            InputError: it cannot be read, or ``SourceError``: it lacks what no trace can do without.
        """
        self.path, self.settings = path, settings

    @abstractmethod
    def episodes(self) -> Sequence[str]:
        """Return the names of the source's episodes in order, without reading their data."""

    @abstractmethod
    def fingerprint(self, name: str) -> str:
        """Return a short text that changes with the episode's data, without reading all of it."""

    @abstractmethod
    def read(self, name: str, account: Account) -> Episode:
        """Read an episode; remark on everything that it lacks in ``account``.

        The header's ``episode_id`` and ``source.episode``, ``.fingerprint``, ``.account`` and
        ``.recorder`` are filled in by the caller, as are the map file's ``[every]`` and
        ``[episode.NAME]``. What the map says of bodies is for the importer to use.

        Raises:
            InputError: this episode cannot be imported; the others may.
        """

    def close(self) -> None:
        """Let go of open files."""


def json_table(path: Path, *, whole: bool = False) -> dict[str, Any]:
    """Return the table of a JSON file that stands beside data; an empty one without it.

    A damaged one is empty, too, or, if it has to be ``whole``, raises SourceError.
    """
    try:
        table = from_json(path.read_text("utf-8"), foreign=True)
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        if whole:
            raise SourceError(str(path), f"cannot be read: {error}.") from None
        return {}
    return table if isinstance(table, dict) else {}
