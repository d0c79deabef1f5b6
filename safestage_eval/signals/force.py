"""Signals of the forces at contacts."""

from __future__ import annotations

import numpy as np

from .facts import Query
from .series import Series, exact


def between(query: Query) -> Series:
    """N, summed over the pairs of two unions, or of one with everything else.

    ``peak_force`` sums the peaks of the pairs, the others the normal forces at the frame.
    """
    episode = query.episode
    if episode.header.force_source == "none":
        return query.unknown("the trace has no contact forces")
    index, sums = episode.body_index, query.facts.contact_sums
    first = {index[body] for body in query.groups[0]}
    second = {index[b] for b in query.groups[1]} if len(query.groups) > 1 else None
    total = np.zeros(len(episode))
    for i, j in sums.pairs:
        other = set(index.values()) - first if second is None else second
        if (i in first and j in other) or (j in first and i in other):
            total = total + (sums.peak(i, j) if query.name == "peak_force" else sums.normal(i, j))
    return exact(total, query.dimension)
