"""Audit findings: plain data that can be pickled, printed and written as JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from safestage_eval.doubts.check_registry import Severity


@dataclass(frozen=True)
class Place:
    """Where a finding is.

    Attributes:
        episode: id of the episode; empty of a finding about several, or where it could not be read.
        path: of its file, as printed.
        bodies: names of the bodies (or joints) it is about; empty if it is about all of them.
        field: of the header, or a column: ``frame_dt``, ``roles.target``, ``bodies.orientation``.
        time: s, when it begins; None where it holds throughout.
    """

    episode: str = ""
    path: str = ""
    bodies: tuple[str, ...] = ()
    field: str = ""
    time: float | None = None


@dataclass(frozen=True)
class Defect:
    """Finding of one check; the audit adds the code and the episode.

    Attributes:
        what: what is wrong, in one sentence with its numbers.
        fix: what to do about it, as an imperative.
        cause: the likely cause; empty where ``what`` says it.
        bodies, field, time: as in ``Place``.
        severity: another one than the check declares; None for that one.
        episodes: ids of the episodes that a finding about several is about.
    """

    what: str
    fix: str
    cause: str = ""
    bodies: tuple[str, ...] = ()
    field: str = ""
    time: float | None = None
    severity: Severity | None = None
    episodes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Finding:
    """One defect, with the check that found it and the episode it was found in.

    Attributes:
        code: of the check, ``AUD104``.
        severity: ``error``: verdicts would be wrong, or there are none; ``warning``: some cannot be
            relied on; ``note``: good to know.
        place: where.
        what, cause, fix: as in ``Defect``.
        episodes: as in ``Defect``.
    """

    code: str
    severity: Severity
    place: Place
    what: str
    cause: str
    fix: str
    episodes: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """All of it as JSON values; the place is flattened into it."""
        values = asdict(self)
        place = values.pop("place")
        return {"code": values.pop("code"), "severity": values.pop("severity"), **place, **values}
