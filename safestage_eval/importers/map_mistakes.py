"""Likely mistakes of a map file or a flag, seen in what was imported before anything is judged.

The audit sees what cannot be right (``audit/checks``). Here its causes are looked for: each mistake
is undone on trial, and the one after which shapes and poses fit is named, with what mends it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from safestage_eval.audit import choose
from safestage_eval.audit.audit_episode import check_subject
from safestage_eval.audit.finding import Finding
from safestage_eval.audit.repair import REPAIRS, Mend, columns
from safestage_eval.audit.start import start_of
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import Check
from safestage_eval.episode import Episode, Track
from safestage_eval.rules import RuleSet, builtin_names, load_rules

from .map_tables import MapFile

LOOKED_AT = (
    "AUD101", "AUD102", "AUD111", "AUD113", "AUD114", "AUD115", "AUD116", "AUD117", "AUD121",
    "AUD122", "AUD123", "AUD124", "AUD126", "AUD127", "AUD131", "AUD132", "AUD133", "AUD134", "AUD144", "AUD201", "AUD203", "AUD204", "AUD210",
    "AUD211", "AUD212",
)  # fmt: skip
"""Checks that see mistakes of units, axes, shapes and places."""

AT_FIRST = ("AUD201", "AUD204", "AUD210")
"""Those of the first frame, by which a cause is found."""

SHORT = {"centimetres": "cm", "millimetres": "mm"}
"""Names of units that ``[source] length`` takes."""

MOST = 4
"""So many mistakes are looked for, one behind another."""

ALIKE = 5e-3
"""m; what hangs in the air over one body by the same height does so for one reason."""

OTHER_ORDER = {
    "xyzw": 'read the quaternions as x, y, z, w: --quaternion xyzw, or quaternion = "xyzw" under [source]',
    "wxyz": 'read the quaternions as w, x, y, z: --quaternion wxyz, or quaternion = "wxyz" under [source]',
}


SIZES = 'write sizes in the map file in metres, or with their unit: "4 cm"'


@dataclass(frozen=True)
class Notice:
    """Something that cannot be right, with the likely mistake.

    Attributes:
        what: what is seen, with its numbers.
        cause: the likely mistake; empty if nothing explains it.
        fix: what the user can do about it.
        bodies: names of the bodies it is about.
        codes: of the checks that saw it.
    """

    what: str
    cause: str
    fix: str
    bodies: tuple[str, ...]
    codes: tuple[str, ...]

    def __str__(self) -> str:
        """In one line: ``what Likely mistake: … Fix: … [AUD204]``."""
        cause = f" Likely mistake: {self.cause}." if self.cause else ""
        return f"{self.what}{cause} Fix: {self.fix}. [{', '.join(self.codes)}]"


def notice(episode: Episode, map_: MapFile) -> tuple[Notice, ...]:
    """Impossible facts of an imported episode; empty for a sound one.

    A mistake may hide others: each that is found is undone, and what is left is looked at again.
    """
    found: dict[tuple[object, ...], Notice] = {}
    for _ in range(MOST):
        some, mended = _seen(episode, map_)
        for one in some:
            found.setdefault((one.codes, one.bodies), one)
        if mended is None:
            break
        episode = mended
    return tuple(found.values())


def _seen(episode: Episode, map_: MapFile) -> tuple[list[Notice], Episode | None]:
    """Impossible facts of an episode, and the episode without one of their causes, if one is known."""
    subject = Subject(episode, _rules())
    findings = check_subject(subject, _checks(LOOKED_AT))
    at_first = [f for f in findings if f.code in AT_FIRST]
    cause = _cause(subject, at_first, map_) if at_first else None
    if cause is not None:
        findings = [f for f in findings if f.code not in AT_FIRST]
    notices = [_plain(f) for f in findings if f.severity != "note"]
    if cause is not None:
        return [cause[0], *notices], cause[1]
    for one in findings:
        for repair in REPAIRS if one.code == "AUD131" else ():
            if (repair.code, repair.cause) == (one.code, one.cause):
                return notices, repair.mend(episode, one.place.bodies)
    return notices, None


def summed(every: Iterable[tuple[Notice, ...]]) -> list[tuple[Notice, int]]:
    """Notices of many episodes, those of one cause once, with how many episodes have each."""
    first: dict[tuple[object, ...], Notice] = {}
    counts: dict[tuple[object, ...], int] = {}
    for some in every:
        for one in some:
            key = (one.cause, one.fix, one.bodies, one.codes)
            first.setdefault(key, one)
            counts[key] = counts.get(key, 0) + 1
    return sorted(((one, counts[key]) for key, one in first.items()), key=lambda pair: -pair[1])


@cache
def _checks(codes: tuple[str, ...]) -> tuple[Check, ...]:
    return choose(codes)


@cache
def _rules() -> RuleSet:
    return load_rules(builtin_names())


def _plain(finding: Finding) -> Notice:
    """A finding in the words of an import."""
    fix = finding.fix
    if finding.code == "AUD111" and "x, y, z, w" in finding.cause:
        fix = OTHER_ORDER["xyzw"]
    elif finding.code == "AUD101":
        fix = _unit_fix(finding.cause) or fix
    elif finding.code == "AUD131" and ("sizes" in finding.cause or "shapes" in finding.cause):
        fix = SIZES
    elif finding.code in ("AUD204", "AUD211", "AUD212") and finding.place.bodies:
        fix = f"{fix}: [body.{finding.place.bodies[-1]}] shapes or position in the map file"
    return Notice(finding.what, finding.cause, fix, finding.place.bodies, (finding.code,))


def _unit_fix(cause: str) -> str:
    unit = next((short for name, short in SHORT.items() if name in cause), None)
    return f'length = "{unit}" under [source] of the map file' if unit else ""


# ---- the cause of what does not fit at the first frame


@dataclass(frozen=True)
class _Trial:
    """A mistake, how it is undone, and the bodies that have it."""

    cause: str
    fix: str
    mend: Mend
    names: tuple[str, ...]


def _cause(subject: Subject, seen: list[Finding], map_: MapFile) -> tuple[Notice, Episode] | None:
    """The mistake without which the most of it is gone, and the episode without it.

    None if no mistake explains nine tenths of it.
    """
    best: tuple[int, _Trial, Episode] | None = None
    for trial in _trials(subject, map_):
        mended = Subject(trial.mend(subject.episode, trial.names), subject.rules)
        if not mended.sound:
            continue
        left = check_subject(mended, _checks(AT_FIRST))
        count = len(left)
        if count < (best[0] if best else len(seen)):
            best = count, trial, mended.episode
        if not count:
            break
    if best is None or best[0] > len(seen) // 10:
        return None
    bodies = tuple(dict.fromkeys(name for one in seen for name in one.place.bodies))
    codes = tuple(dict.fromkeys(one.code for one in seen))
    more = f" And {len(seen) - 1} more like this." if len(seen) > 1 else ""
    _, trial, without = best
    return Notice(seen[0].what + more, trial.cause, trial.fix, bodies, codes), without


def _trials(subject: Subject, map_: MapFile) -> Iterator[_Trial]:
    """Mistakes that an import makes possible, the likeliest first."""
    placed = {name for name, entry in map_.body.items() if entry.position is not None}
    read = tuple(name for name in subject.episode.tracks if name not in placed)
    shaped = tuple(b.name for b in subject.header.bodies if b.geoms and _has_shapes(map_, b.name))
    for order, by in (("xyzw", 1), ("wxyz", -1)):
        yield _Trial(
            f"quaternions of the source are {', '.join(order)}, and were read in the other order",
            OTHER_ORDER[order], _rolled(by), read,
        )  # fmt: skip
    yield from _shifts(subject, placed)
    for repair in REPAIRS:
        if repair.code == "AUD101" and "velocities" in repair.cause:
            if fix := _unit_fix(repair.cause):
                yield _Trial(f"{repair.cause} in the source", fix, repair.mend, read)
        elif repair.code == "AUD131":
            unit = repair.cause.rpartition(" ")[2]
            yield _Trial(
                f"sizes of shapes are in {unit}",
                SIZES,
                repair.mend, shaped,
            )  # fmt: skip
        elif repair.code == "AUD111" and "into the body" in repair.cause:
            yield _Trial(repair.cause, repair.fix, repair.mend, read)


def _has_shapes(map_: MapFile, name: str) -> bool:
    entry = map_.of_body(name)
    return entry is not None and "shapes" in entry.model_fields_set


def _rolled(by: int) -> Mend:
    return lambda episode, names: columns(
        episode, names, orientation=lambda q: np.roll(q, by, axis=1)
    )


def _shifts(subject: Subject, placed: Collection[str]) -> Iterator[_Trial]:
    """A fixture that is too low or too high by what several objects, or the only one, hang over it."""
    start = start_of(subject)
    if start is None:
        return
    gaps: dict[str, list[float]] = {}
    for body in start.moved:
        mine = start.boxes(body)
        for other in start.solid if mine is not None else ():
            theirs = start.boxes(other) if other.geoms and not other.movable else None
            if mine is None or theirs is None:
                continue
            middle = (mine[0].min(axis=0) + mine[1].max(axis=0))[:2] / 2
            under = ((theirs[0][:, :2] <= middle) & (middle <= theirs[1][:, :2])).all(axis=1)
            if under.any():
                tops = mine[0][:, 2].min() - theirs[1][under, 2]
                gaps.setdefault(other.name, []).append(float(tops[np.abs(tops).argmin()]))
    for name, by in ((name, by) for name, some in gaps.items() for by in _distinct(some)):
        if abs(by) < ALIKE:
            continue
        low = "low" if by > 0 else "high"
        x, y, z = subject.track(name).position[0].tolist()
        where = (
            f"position = [{x:.4g}, {y:.4g}, {z + by:.4g}]"
            if name in placed
            else "its shapes or its place in the source"
        )
        yield _Trial(
            f"{name!r} is {100 * abs(by):.1f} cm too {low}",
            f"[body.{name}] {where} in the map file",
            _raised(by),
            (name,),
        )


def _distinct(values: list[float]) -> list[float]:
    """One of each group of values within ``ALIKE`` of each other, the largest group first."""
    groups: list[list[float]] = []
    for value in sorted(values):
        if groups and value - groups[-1][0] <= ALIKE:
            groups[-1].append(value)
        else:
            groups.append([value])
    return [float(np.median(group)) for group in sorted(groups, key=len, reverse=True)][:4]


def _raised(by: float) -> Mend:
    def mend(episode: Episode, names: Collection[str]) -> Episode:
        tracks = dict(episode.tracks)
        for name in names:
            old = tracks[name]
            up = np.array([0, 0, by], np.float32)
            tracks[name] = Track(
                old.position + up, old.orientation, old.linear_velocity, old.angular_velocity
            )
        return replace(episode, tracks=tracks)

    return mend
