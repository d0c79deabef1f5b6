"""Checks of up and down: the axis that points up, and gravity as falls and bodies at rest show it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.start import start_of
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import also
from safestage_eval.episode.clock import MAX_GAP
from safestage_eval.evidence.motion import com_position

FLIGHT = 0.1
"""s that a body must be in the air for its acceleration to be measured."""

BORNE = 0.1
"""Share by which the force on a body at rest may differ from its weight; recorded ones by .001."""

LOOKS, RESTS = 24, 2e-4
"""Frames that are looked at, and m by which a body at rest moves over ten of them."""

GAP = 0.01
"""m between an object and what it stands on, by their boxes."""

OFF = 0.25
"""Share by which free fall may differ from gravity: drag of the air and of joints, coarse samples."""


@also("AUD113")
def up_axis(subject: Subject) -> Iterator[Defect]:
    """Reads it from forces on bodies at rest, and from free falls.

    Without contacts, from shapes: where objects stand on others along another axis, and none along z.
    """
    if subject.diagnosis.repair is not None:
        return
    for body, fall, time in _falls(subject):
        size = float(np.linalg.norm(fall))
        if size > 1 and -fall[2] < 0.7 * size:
            axis = "xyz"[int(np.abs(fall).argmax())]
            yield Defect(
                f"{body!r} falls along {axis} at {time:.2f} s: its acceleration is "
                f"({', '.join(f'{a:.1f}' for a in fall)}) m/s².",
                "turn everything so that z points up: (x, y, z) becomes (x, -z, y) if y does",
                f"the {axis} axis points up or down",
                bodies=(body,),
                field="bodies.position",
                time=time,
            )
            return
    start = start_of(subject)
    if start is None or not start.blind or any(b.unseen for b in start.solid):
        return
    axes = start.resting_axes(GAP)
    for bit, axis in ((2, "y"), (1, "x")):
        names = [name for name, bits in axes.items() if bits == bit]
        if names and len(names) == sum(bits > 0 for bits in axes.values()):
            yield Defect(
                f"at the first frame {', '.join(map(repr, names))} stands on another body along {axis}, "
                "and no object stands on anything along z.",
                "turn everything so that z points up: (x, y, z) becomes (x, -z, y) if y does",
                f"the {axis} axis points up",
                field="bodies.position",
                time=float(subject.episode.t[0]),
                severity="warning",
            )
            return


@also("AUD117")
def gravity(subject: Subject) -> Iterator[Defect]:
    """Fits the acceleration of bodies that nothing touches for a tenth of a second.

    Likewise the forces on two or more bodies at rest, divided by their masses.
    """
    stated = -subject.header.gravity[2]
    if not subject.readable or subject.diagnosis.repair is not None:
        return
    borne = [share * stated for share in borne_shares(subject).values()]
    middle = float(np.median(borne)) if len(borne) > 1 else stated
    if abs(middle - stated) > BORNE * stated and np.ptp(borne) <= BORNE * middle:
        yield Defect(
            f"{len(borne)} bodies at rest are borne by {middle:.3g} N for each kg, gravity in the header "
            f"is {stated:.3g} m/s².",
            "write the gravity of the simulation",
            "the header has a default gravity, or all masses were scaled",
            field="gravity",
        )
        return
    falls = [(body, -fall[2], time) for body, fall, time in _falls(subject) if -fall[2] > 0.3]
    if not falls:
        return
    body, size, time = sorted(falls, key=lambda one: one[1])[len(falls) // 2]
    if abs(size - stated) <= OFF * stated:
        return
    ratio = size / stated
    causes = {
        100: "centimetres for metres",
        1000: "millimetres for metres",
        3.28: "feet for metres",
    }
    cause = next((c for r, c in causes.items() if abs(ratio / r - 1) < OFF), "")
    yield Defect(
        f"{body!r} falls with {size:.3g} m/s² at {time:.2f} s, gravity in the header is {stated:.3g}.",
        "write the gravity of the simulation, and lengths in m and times in s",
        cause or "the header has a default gravity, or time stamps run at another speed",
        bodies=(body,),
        field="gravity",
        time=time,
    )


def borne_shares(subject: Subject) -> dict[str, float]:
    """Free object → upward force on it over its weight, at the median of some frames in which it rests.

    Only of objects that rest in most of these frames, and that contacts with forces touch.
    """
    episode, t = subject.episode, subject.episode.t
    gravity, share_of = -subject.header.gravity[2], dict[str, float]()
    unsaid = subject.header.force_source in ("normal", "none")
    if unsaid or len(t) < 50 or not gravity > 0:
        return share_of
    if "borne" not in subject.notes:
        jointed = {b.parent for b in subject.header.bodies} | {
            j.body for j in subject.header.joints
        }
        at = np.linspace(5, len(t) - 6, LOOKS).astype(int)
        for body in subject.objects:
            place = subject.track(body.name).position
            if not body.mass or body.name in jointed or body.parent is not None:
                continue
            still = np.linalg.norm(place[at + 5] - place[at - 5], axis=1) < RESTS
            index, up = episode.body_index[body.name], np.zeros(len(t))
            for pair in episode.contacts.pairs if 2 * still.sum() > LOOKS else ():
                if index in pair:
                    frame, force = episode.contacts.of_pair(pair, "frame", "force.z")
                    up += (1 if pair[1] == index else -1) * np.bincount(frame, force, len(t))
            shares = up[at][still] / (body.mass * gravity)
            if len(shares) and np.isfinite(shares).all() and shares.any():
                share_of[body.name] = float(np.median(shares))
        subject.notes["borne"] = share_of
    known: dict[str, float] = subject.notes["borne"]
    return known


def _falls(subject: Subject) -> list[tuple[str, NDArray[Any], float]]:
    """Objects in the air: name, (3,) m/s² of the fitted acceleration, and s when it begins."""
    if not subject.readable or subject.header.force_source == "none":
        return []
    if "falls" not in subject.notes:
        subject.notes["falls"] = [*_measured_falls(subject)]
    falls: list[tuple[str, NDArray[Any], float]] = subject.notes["falls"]
    return falls


def _measured_falls(subject: Subject) -> Iterator[tuple[str, NDArray[Any], float]]:
    t = subject.episode.t
    if len(t) < 5:
        return
    spacing = float(np.median(np.diff(t)))
    for body in subject.objects:
        touched = subject.touched.get(body.name)
        if touched is None or touched.all() or not touched.any():
            continue  # of a body without a single contact nobody knows what it touches
        edges = np.flatnonzero(np.diff(np.concatenate([[True], touched, [True]]).astype(np.int8)))
        for begins, ends in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            first, stop = begins + 1, ends - 1  # clear of the touches themselves
            if stop - first < 5 or t[stop - 1] - t[first] < FLIGHT:
                continue
            at = t[first:stop] - t[first]
            if np.diff(at).max() > MAX_GAP * spacing:
                continue
            place = com_position(subject.episode, body.name)[first:stop]
            if not np.isfinite(place).all():
                continue
            parts, rest, *_ = np.polynomial.polynomial.polyfit(at, place, 2, full=True)
            spread = float(np.sqrt(rest[0].sum() / len(at)))
            if spread < 0.01 * (np.linalg.norm(parts[2]) * at[-1] ** 2 + 1e-3):
                yield body.name, 2 * parts[2], float(t[first])
