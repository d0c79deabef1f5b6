"""Checks of contacts and forces: against shapes, against weights, and within themselves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import check

PULLS = 0.2
"""Share of the forces that may pull: solvers with soft contacts let a few."""

UNIT = 0.01
"""By which the square of a normal's length may differ from 1."""


@check(
    "AUD125",
    "warning",
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
