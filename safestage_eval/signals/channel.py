"""The signal of a recorded scalar: temperature, fill level, whatever a simulator or sensor gave."""

from __future__ import annotations

import numpy as np

from safestage_eval.units import UNIT_DIMENSION, in_si

from .facts import Query
from .series import Series, exact


def value(query: Query) -> Series:
    """The channel in SI, if it is in the unit that the variant says; else as recorded.

    Of a union: the one of the only body that has such a channel.
    """
    name, bodies = str(query.option("channel")), query.groups[0]
    found = [body for body in bodies if (body, name) in query.episode.channels]
    if len(found) != 1:
        if found:
            return query.unknown(f"several bodies have a channel {name}: {', '.join(found)}")
        return query.unknown(f"the trace has no channel {name} of {query.bodies[0]}")
    recorded = np.asarray(query.episode.channels[found[0], name], np.float64)
    unit = str(query.option("unit") or "1")
    if unit not in UNIT_DIMENSION:
        return exact(recorded, query.dimension)
    scale = in_si(1.0, unit) - in_si(0.0, unit)
    return exact(recorded * scale + in_si(0.0, unit), UNIT_DIMENSION[unit])
