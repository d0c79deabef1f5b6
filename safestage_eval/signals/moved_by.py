"""Effect of a touch on a body at rest: how far it moves, and how far it tips."""

from __future__ import annotations

from typing import TYPE_CHECKING

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

AFTER = Option(
    "over",
    "time",
    "For how long after the touch its effect is looked for; 0.5 s if left out.",
    default=0.5,
    param=True,
)


@signal(
    "moved_by", "length", args=("a", "b"), needs=("poses", "touch"), groups=True, options=(AFTER,),
    reads="", symmetric=True, support=True,
)  # fmt: skip
def moved_by(request: Request) -> Interval:
    """While the two touch: how far one of them, which was at rest, goes at once and within the
    stated time after; 0 when they do not touch. The robot itself does not count.
    """
    from safestage_eval.relations.touch_effect import effect_of_touch

    return effect_of_touch(request)


@signal(
    "tipped_by", "angle", args=("a", "b"), needs=("poses", "touch"), groups=True, scale=0.0175,
    options=(AFTER,), reads="", symmetric=True, support=True,
)  # fmt: skip
def tipped_by(request: Request) -> Interval:
    """The same of the angle by which its up axis leans away from how it stood."""
    from safestage_eval.relations.touch_effect import effect_of_touch

    return effect_of_touch(request)
