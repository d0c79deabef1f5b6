"""What a ``[signal.NAME]`` may add to a built-in signal: options, their kinds and their values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

OptionValue = float | str | tuple[float, ...]

Options = tuple[tuple[str, OptionValue], ...]
"""Option → value in SI, sorted by name: from the signal's definition and the body's material."""


@dataclass(frozen=True)
class OptionSpec:
    """One option.

    Attributes:
        name: key under ``[signal.NAME]``.
        kind: ``time`` (s), ``length`` (m), ``channel`` (name of a recorded one), ``unit``, ``box``
            (two corners, m) or ``choice``.
        meaning: one sentence.
        required: there is no sensible default.
        choices: the values that a unit or choice may have; empty for any unit.
        default: the number that is meant where it is left out, if there is one.
        param: it may be the name of a parameter, so that it can be swept; left out, it is the value of
            the parameter of its own name, where the rules declare one, and only then the default.
    """

    name: str
    kind: Literal["time", "length", "channel", "unit", "box", "choice"]
    meaning: str
    required: bool = False
    choices: tuple[str, ...] = ()
    default: float | None = None
    param: bool = False


DEFAULT_OVER = 0.05
"""s: the time over which a change of velocity counts as one impact, unless a variant says so.

One control step at 20 Hz, as in RoboCasa, one of the two simulators of OopsieVerse
(arXiv 2606.31993).
"""

OVER = OptionSpec(
    "over",
    "time",
    "The time over which a change of velocity is one impact; 50 ms if left out.",
    default=DEFAULT_OVER,
)
DEFAULT_DROP = 0.02
"""m: a step down by less is no edge, unless rules say otherwise."""

DROP = OptionSpec(
    "edge_drop",
    "length",
    "A step down by less is no edge; the parameter edge_drop if left out, and 2 cm without one.",
    default=DEFAULT_DROP,
    param=True,
)
EFFECT_OVER = 0.5
"""s: for so long what a touch does to a body is seen as its effect, unless a variant says so."""

AFTER = OptionSpec(
    "over",
    "time",
    "For how long after the touch its effect is looked for; 0.5 s if left out.",
    default=EFFECT_OVER,
    param=True,
)
WITHIN = OptionSpec(
    "over",
    "time",
    "How far it went or turned within so long before, per time, from its poses; the recorded velocity "
    "if left out.",
    param=True,
)
BOX = OptionSpec(
    "box",
    "box",
    'Two opposite corners: [["-0.5 m", "-1 m", "0 m"], ["1 m", "1 m", "1.5 m"]].',
    True,
)
CHANNEL = OptionSpec("channel", "channel", "The name of a recorded scalar of the body.", True)
CHANNEL_UNIT = OptionSpec("unit", "unit", "The unit it is recorded in; a plain number if left out.")
NORM = OptionSpec(
    "norm",
    "choice",
    "How the coordinates add up: l2 (the distance), l1 (the sum) or max (the largest).",
    choices=("l2", "l1", "max"),
)
JOINT_SPEED_UNIT = OptionSpec(
    "unit",
    "unit",
    "rad/s for joints that turn, m/s for those that slide.",
    choices=("rad/s", "m/s"),
)
JOINT_FORCE_UNIT = OptionSpec(
    "unit", "unit", "N m for joints that turn, N for those that slide.", choices=("N m", "N")
)
