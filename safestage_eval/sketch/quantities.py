"""The strings of a sketch: quantities with units, vectors, spans of time, curves, shapes.

Numbers may be sums, ``"5 + 7.9 cm"``, so that a knob can stand in the middle of a layout. Every
function raises ValueError with a sentence that says what would have been accepted.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from safestage_eval.units import DIMENSIONS, finite

UNITS: dict[str, dict[str, float]] = {**DIMENSIONS, "mass": {"kg": 1.0, "g": 1e-3}}
"""Those of rule files, and masses."""

Vec3 = tuple[float, float, float]

_NUMBER = r"-?\d+(?:\.\d+)?"
_SUM = rf"{_NUMBER}(?: *[+-] *{_NUMBER})*"
_TERM = re.compile(rf"([+-]?) *({_NUMBER})")

SHAPES = {
    "box": ("x", "y", "z"),
    "cylinder": ("diameter", "height"),
    "capsule": ("diameter", "height"),
    "sphere": ("diameter",),
    "ellipsoid": ("x", "y", "z"),
    "bin": ("x", "y", "z"),
    "cup": ("diameter", "height"),
}
"""Shape → what its sizes are, outside and in this order."""

HOLLOW = ("bin", "cup")
"""Open at the top; they have walls and a cavity."""


@dataclass(frozen=True)
class Part:
    """One shape of a body, standing with its bottom's middle at a point of the body's frame.

    Attributes:
        kind: one of ``SHAPES``.
        size: m, as ``SHAPES`` names them.
        wall: m, thickness of a hollow one's walls and floor; 0 otherwise.
        along: the axis of a cylinder or capsule; z is upright.
        at: m, where it stands in the body's frame.
    """

    kind: str
    size: tuple[float, ...]
    wall: float = 0.0
    along: Literal["x", "y", "z"] = "z"
    at: Vec3 = (0.0, 0.0, 0.0)


def number(text: str) -> float:
    """``"5 + 7.9"`` → 12.9."""
    if not re.fullmatch(_SUM, text.strip()):
        raise ValueError(f"{text!r} is no number")
    terms = _TERM.findall(text)
    return finite(sum(-finite(value) if sign == "-" else finite(value) for sign, value in terms))


def quantity(value: str | float, dimension: str) -> float:
    """``"8 cm"`` → 0.08. A ratio may be a bare number."""
    units = UNITS[dimension]
    if dimension == "ratio" and isinstance(value, int | float):
        return finite(value)
    ending = "|".join(re.escape(u) for u in sorted(units, key=len, reverse=True))
    match = re.fullmatch(rf"({_SUM}) ?({ending})", str(value).strip())
    if match is None:
        if dimension == "angle":
            axis = "; the axis goes in `about`" if " about " in str(value) else ""
            raise ValueError(
                f"{value!r} is not an angle; write a number and {' or '.join(units)}, such as "
                f"'30 deg'{axis}"
            )
        raise ValueError(f"{value!r} is no {dimension}: a number with {', '.join(units)}")
    return finite(number(match[1]) * units[match[2]])


def vector(value: str, dimension: str = "length", components: tuple[int, ...] = (3,)) -> Vec3:
    """``"30, 0, 12 cm"`` → (0.3, 0.0, 0.12). Where two numbers will do, the third is 0."""
    names = "x, y, z" if components == (3,) else "x, y or x, y, z"
    head, _, unit = str(value).strip().rpartition(" ")
    parts = head.split(",")
    if unit not in UNITS[dimension] or len(parts) not in components:
        raise ValueError(
            f"{value!r} is no vector: {names}, then one of {', '.join(UNITS[dimension])}"
        )
    out = [finite(number(part) * UNITS[dimension][unit]) for part in parts]
    return (out[0], out[1], out[2] if len(out) > 2 else 0.0)


def span(value: str) -> tuple[float, float]:
    """``"1 to 2.5 s"``, ``"1 s to end"``, ``"start to end"``: seconds; the end is infinity."""
    units = "|".join(UNITS["time"])
    match = re.fullmatch(
        rf"(start|{_SUM})(?: ?({units}))? to (end|({_SUM}) ?({units}))", str(value).strip()
    )
    if match is None:
        raise ValueError(
            f'{value!r} is no span of time: "1 to 2.5 s", "1 s to end", "start to 2 s"'
        )
    unit = match[2] or match[5]
    if match[1] != "start" and unit is None:
        raise ValueError(f'{value!r}: the first number has no unit, as in "1 s to end"')
    first = 0.0 if match[1] == "start" else number(match[1]) * UNITS["time"][unit]
    last = float("inf") if match[3] == "end" else number(match[4]) * UNITS["time"][match[5]]
    if not 0 <= first <= last:
        raise ValueError(f"{value!r} ends before it begins, or begins before the scene does")
    return first, last


def curve(value: str, dimensions: tuple[str, ...]) -> tuple[tuple[float, float], ...]:
    """``"0 deg at 0 s, 90 deg at 2 s"`` → ((0, 0), (2, π/2)): time and value, straight between."""
    knots = []
    for item in str(value).split(","):
        amount, at, when = item.partition(" at ")
        if not at:
            raise ValueError(f'{item.strip()!r} is no point of a curve: "VALUE at TIME"')
        knots.append((quantity(when, "time"), _any(amount.strip(), dimensions)))
    if [k[0] for k in knots] != sorted({k[0] for k in knots}):
        raise ValueError(f"{value!r}: the times of a curve must increase")
    return tuple(knots)


def turn(value: str) -> tuple[float, Literal["x", "y", "z"]]:
    """``"30 deg about y"`` → angle in rad and world axis."""
    match = re.fullmatch(r"(.+) about ([xyz])", str(value).strip())
    if match is None:
        raise ValueError(f'{value!r} is no turn: "30 deg about y"')
    return quantity(match[1], "angle"), match[2]  # type: ignore[return-value]


def shape(value: str) -> Part:
    """``"box 6 x 6 x 12 cm"``, ``"cylinder 6 x 20 cm along x at 0, 0, 2 cm"``, ….

    A hollow one names its wall: ``"bin 20 x 15 x 10 cm wall 1 cm"``. Sizes are outer ones.
    """
    match = re.fullmatch(
        r"(?P<kind>[a-z]+) (?P<size>[^a-z]+(?: x [^a-z]+)*) ?(?P<unit>cm|mm|m)"
        r"(?: wall (?P<wall>.+?))?(?: along (?P<along>[xyz]))?(?: at (?P<at>.+))?",
        str(value).strip(),
    )
    if match is None or match["kind"] not in SHAPES:
        forms = "; ".join(f"{kind} {' x '.join(sizes)} cm" for kind, sizes in SHAPES.items())
        raise ValueError(f"{value!r} is no shape: {forms}")
    kind, names = match["kind"], SHAPES[match["kind"]]
    size = tuple(number(s) * UNITS["length"][match["unit"]] for s in match["size"].split(" x "))
    if len(size) != len(names) or min(size) <= 0:
        raise ValueError(f"a {kind} has {len(names)} positive sizes: {' x '.join(names)}")
    if (kind in HOLLOW) != (match["wall"] is not None):
        verb = "needs" if kind in HOLLOW else "has no"
        raise ValueError(f'a {kind} {verb} wall, as in "bin 20 x 15 x 10 cm wall 1 cm"')
    if match["along"] and kind not in ("cylinder", "capsule"):
        raise ValueError(f"along says how a cylinder or capsule lies; a {kind} has no axis")
    wall = quantity(match["wall"], "length") if match["wall"] else 0.0
    if kind in HOLLOW and not 0 < 2 * wall < min(size):
        raise ValueError(f"walls of {match['wall']} leave no room in a {kind} of that size")
    at = vector(match["at"]) if match["at"] else (0.0, 0.0, 0.0)
    return Part(kind, size, wall, match["along"] or "z", at)  # type: ignore[arg-type]


def _any(text: str, dimensions: tuple[str, ...]) -> float:
    """A quantity of one of several dimensions."""
    for dimension in dimensions:
        if dimension == "ratio" and re.fullmatch(_SUM, text):
            return number(text)
        try:
            return quantity(text, dimension)
        except ValueError:
            continue
    allowed = ", ".join(unit for dimension in dimensions for unit in UNITS[dimension])
    raise ValueError(f"{text!r} is no quantity: a number with {allowed}")
