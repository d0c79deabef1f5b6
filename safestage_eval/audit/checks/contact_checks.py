"""Checks of contacts and forces: against shapes, against weights, and within themselves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.audit.audit_check import check
from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject

PULLS = 0.2
"""Share of the forces that may pull: solvers with soft contacts let a few."""

UNIT = 0.01
"""By which the square of a normal's length may differ from 1."""

CAUSES = ("AUD101", "AUD111", "AUD113", "AUD116", "AUD131")


@check(
    "AUD121",
    "error",
    of="recording",
    title="contacts are not where the bodies are",
    why="Touches, support and forces are those of other bodies, or of another moment.",
    example="contacts counted from another frame, or given in a body's own frame",
    unless=(*CAUSES, "AUD114", "AUD115"),
)
def contact_places(subject: Subject) -> Iterator[Defect]:
    """Asks for contact points within 3 cm of the surfaces of both bodies, and for bodies that meet."""
    yield from subject.explained("AUD121", "apart", "surface")


@check(
    "AUD122",
    "error",
    of="recording",
    title="bodies overlap deeper than any solver lets them",
    why="Depths are lengths in metres; where forces are missing, touches are decided from them.",
    example="depths in millimetres",
    unless=CAUSES,
)
def depths(subject: Subject) -> Iterator[Defect]:
    """Asks for depths of 10 cm at the most."""
    yield from subject.explained("AUD122", "depth")


@check(
    "AUD123",
    "error",
    of="recording",
    title="forces are not those that bear the weights",
    why="Support, dependence and grip are decided by forces in newtons on body 2 by body 1.",
    example="forces in kN, or those on body 1 by body 2",
    issue="isaac-sim/IsaacLab#2193",
    unless=(*CAUSES, "AUD114", "AUD115", "AUD117", "AUD121", "AUD132"),
)
def weights(subject: Subject) -> Iterator[Defect]:
    """Adds up the forces on free bodies at rest and compares them with their weight."""
    yield from subject.explained("AUD123", "bears", "presses", "aside")


@check(
    "AUD124",
    "error",
    of="recording",
    title="peak forces are below the forces",
    why="The peak of a pair is its largest force in any physics step of the frame; rules about force "
    "limits are judged by it.",
    example="peaks of single contact points beside summed forces",
)
def peaks(subject: Subject) -> Iterator[Defect]:
    """Compares the peak of a pair with its force at the frame."""
    yield from subject.explained("AUD124", "peak")


@check(
    "AUD125",
    "warning",
    of="recording",
    title="contact forces are said to be recorded, and are not",
    why="Forces that are zero or NaN throughout are unknown: rules about force are inconclusive, and "
    "support is decided from shapes.",
    example='force_source = "recorded", and a column of zeros',
    issue="isaac-sim/IsaacLab#882",
)
def no_forces(subject: Subject) -> Iterator[Defect]:
    """Compares force_source with the column of forces."""
    header = subject.header
    if header.force_source == "none" or not subject.readable:
        return
    table, field = subject.episode.contacts, "contacts.force"
    if not len(table):
        if any(body.geoms and body.mass for body in subject.objects):
            yield Defect(
                f'force_source is "{header.force_source}", but there is not a single contact.',
                'record contacts, or set force_source = "none"',
                field=field,
            )
        return
    (force,) = table.unordered("force")
    if not np.nan_to_num(force).any():
        yield Defect(
            f'force_source is "{header.force_source}", but the forces of all {len(table)} contacts are '
            f"{'not finite' if np.isnan(force).any() else 'zero'}.",
            'record forces (N, world, on body 2 by body 1), or set force_source = "none"',
            "the recorder asked for contacts before forces were computed",
            field=field,
        )


@check(
    "AUD126",
    "error",
    of="recording",
    title="forces pull, or normals are no directions",
    why="A contact only presses. Where a force pulls, or a normal has another length than 1, the force "
    "of the pair is unknown, and with it support and grip.",
    example="normals from body 2 to body 1",
    unless=("AUD113", "AUD123"),
)
def pulling_forces(subject: Subject) -> Iterator[Defect]:
    """Multiplies forces with normals, and measures the length of normals."""
    if not subject.readable or not len(subject.episode.contacts):
        return
    table = subject.episode.contacts
    normal, force = table.unordered("normal", "force")
    off = np.abs(_product(normal, normal) - 1) > UNIT
    if off.mean() > PULLS:
        square = np.einsum("ij,ij->i", table.normal, table.normal)  # by frame
        first = (np.abs(square - 1) > UNIT).argmax()
        yield Defect(
            f"{off.mean():.0%} of {len(table)} normals are not of length 1; the first has "
            f"{np.sqrt(square[first]):.3g}.",
            "write unit vectors, from body 1 to body 2",
            "normals were scaled with lengths, or never filled in",
            field="contacts.normal",
        )
        return
    along = _product(normal, force)
    strong = np.abs(along) > 0.01 * np.nanmax(np.abs(along), initial=0) + 1e-6
    if strong.any() and (pulls := float((along[strong] < 0).mean())) > PULLS:
        yield Defect(
            f"{pulls:.0%} of the forces pull: they point against their normal.",
            "write the force on body 2 by body 1, and the normal from body 1 to body 2",
            "forces are those on body 1 by body 2, or normals point from body 2 to body 1",
            field="contacts.force",
        )


def _product(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """(N,) scalar products of (N, 3) vectors; einsum takes three times as long over axes so short."""
    product: NDArray[Any] = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return product


@check(
    "AUD127",
    "error",
    of="recording",
    title="a body neither falls nor touches anything",
    why="What bears it is not recorded, so support, rest and dependence cannot be decided.",
    example="a recorder that leaves out contacts with the table",
    unless=(*CAUSES, "AUD114", "AUD115", "AUD117", "AUD121", "AUD123"),
)
def floating(subject: Subject) -> Iterator[Defect]:
    """Looks for free bodies that stay where they are though no contact of theirs is recorded."""
    yield from subject.explained("AUD127", "floats")
