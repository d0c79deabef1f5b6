"""A recorded scalar: temperature, fill level, or whatever a simulator or sensor gave."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval, exact
from safestage_eval.units import UNIT_DIMENSION, in_si

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

NAME = Option("channel", "channel", "The name of a recorded scalar of the body.", required=True)
UNIT = Option("unit", "unit", "The unit it is recorded in; a plain number if left out.")


@signal(
    "channel", "number", args=("name", "a"), needs=("channel",), groups=True, scale=1.0,
    options=(NAME, UNIT), named="channel", reads="",
)  # fmt: skip
def channel(request: Request) -> Interval:
    """A recorded scalar of the body, by its name: temperature, fill level and so on.

    SI, if it is in the unit that the variant says; else as recorded. Of a union: the one of the only
    body that has such a channel.
    """
    name, bodies = str(request.option("channel")), request.groups[0]
    having = [body for body in bodies if (body, name) in request.episode.channels]
    if len(having) != 1:
        if having:
            return request.unknown(f"several bodies have a channel {name}: {', '.join(having)}")
        return request.unknown(f"the trace has no channel {name} of {request.bodies[0]}")
    recorded = np.asarray(request.episode.channels[having[0], name], np.float64)
    unit = str(request.option("unit") or "1")
    if unit not in UNIT_DIMENSION:
        return request.exact(recorded)
    scale = in_si(1.0, unit) - in_si(0.0, unit)
    return exact(recorded * scale + in_si(0.0, unit), UNIT_DIMENSION[unit])
