"""Units of measurement: parsing what people write, printing what people read.

Inside SafeStage every number is in SI; units appear only in rule files and in reports.
"""

from __future__ import annotations

import math

DIMENSIONS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "rate": {"rad/s": 1.0, "deg/s": math.pi / 180},
    "force": {"N": 1.0, "mN": 1e-3},
    "impulse": {"N s": 1.0},
    "torque": {"N m": 1.0},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "temperature": {"degC": 1.0, "K": 1.0},
    "acceleration": {"m/s^2": 1.0, "cm/s^2": 1e-2},
    "jerk": {"m/s^3": 1.0, "cm/s^3": 1e-2},
    "angular acceleration": {"rad/s^2": 1.0, "deg/s^2": math.pi / 180},
    "angular jerk": {"rad/s^3": 1.0, "deg/s^3": math.pi / 180},
    "squared jerk": {"m^2/s^6": 1.0},
    "integrated squared jerk": {"m^2/s^5": 1.0},
    "squared angular jerk": {"rad^2/s^6": 1.0},
    "integrated squared angular jerk": {"rad^2/s^5": 1.0},
    "area": {"m^2": 1.0, "cm^2": 1e-4},
    "stay": {"m s": 1.0, "cm s": 1e-2},
    "force rate": {"N/s": 1.0},
    "power": {"W": 1.0},
    "heating": {"K/s": 1.0},
    "frequency": {"1/s": 1.0, "%/s": 1e-2},
    "ratio": {"%": 1e-2},
    "number": {},
}
"""Dimension → unit → factor to SI (temperatures: to °C). A ratio may be written without a unit,
a plain number (a count, a recorded flag) has none. A stay is a length for so long."""

_POWERS: dict[str, dict[str, int]] = {
    "length": {"m": 1}, "angle": {"rad": 1}, "speed": {"m": 1, "s": -1}, "rate": {"rad": 1, "s": -1},
    "force": {"N": 1}, "impulse": {"N": 1, "s": 1}, "torque": {"N": 1, "m": 1}, "time": {"s": 1},
    "temperature": {"K": 1}, "acceleration": {"m": 1, "s": -2}, "jerk": {"m": 1, "s": -3},
    "angular acceleration": {"rad": 1, "s": -2}, "angular jerk": {"rad": 1, "s": -3},
    "squared jerk": {"m": 2, "s": -6}, "integrated squared jerk": {"m": 2, "s": -5},
    "squared angular jerk": {"rad": 2, "s": -6}, "integrated squared angular jerk": {"rad": 2, "s": -5}, "area": {"m": 2},
    "stay": {"m": 1, "s": 1}, "force rate": {"N": 1, "s": -1}, "power": {"N": 1, "m": 1, "s": -1},
    "heating": {"K": 1, "s": -1}, "frequency": {"s": -1}, "ratio": {}, "number": {},
}  # fmt: skip
"""Dimension → power of each unit that it is made of."""

ZERO = {"K": -273.15}
"""Unit → where its zero lies in SI, if that is not 0."""

UNIT_DIMENSION: dict[str, str] = {
    unit: dimension for dimension, units in DIMENSIONS.items() for unit in units
}
"""Unit → dimension; every unit belongs to exactly one."""

_PREFERRED = {
    "length": ("cm", 1),
    "angle": ("deg", 1),
    "speed": ("cm/s", 1),
    "rate": ("rad/s", 3),
    "force": ("N", 2),
    "impulse": ("N s", 3),
    "torque": ("N m", 2),
    "time": ("s", 2),
    "temperature": ("degC", 1),
    "acceleration": ("m/s^2", 2),
    "jerk": ("m/s^3", 1),
    "angular acceleration": ("rad/s^2", 2),
    "angular jerk": ("rad/s^3", 1),
    "squared jerk": ("m^2/s^6", 1),
    "integrated squared jerk": ("m^2/s^5", 2),
    "squared angular jerk": ("rad^2/s^6", 1),
    "integrated squared angular jerk": ("rad^2/s^5", 2),
    "area": ("cm^2", 1),
    "stay": ("cm s", 2),
    "force rate": ("N/s", 1),
    "power": ("W", 2),
    "heating": ("K/s", 2),
    "frequency": ("1/s", 3),
    "ratio": ("%", 1),
}


LONGEST = 1e9
"""Seconds of the longest time, and the greatest number of frames or of things that are counted."""


def finite(number: str | float) -> float:
    """A number, or its digits, as a float. Every reader of numbers that people write asks here.

    Raises ValueError for what is none, NaN, infinity, and numbers that are too large for a float.
    """
    try:
        value = float(number)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise ValueError("a number that is not finite, or has too many digits")
    return value


FINITE = "finite numbers, below 1e308"
"""What ``finite`` allows, in words."""


def powers_of(dimension: str) -> dict[str, int]:
    """The power of each SI unit in a dimension: a speed is m¹ s⁻¹. Forces count as a unit."""
    return _POWERS[dimension]


def dimension_of_powers(powers: dict[str, int]) -> str | None:
    """The dimension made of these powers, those of 0 aside; None if it has no name."""
    kept = {unit: power for unit, power in powers.items() if power}
    return next((name for name, made_of in _POWERS.items() if made_of == kept), None)


def same_kind(first: str, second: str) -> bool:
    """Two dimensions that may be compared: equal ones, and plain numbers with ratios."""
    return first == second or {first, second} == {"number", "ratio"}


def in_si(number: float, unit: str) -> float:
    """A number in a unit of ``DIMENSIONS``, in SI; temperatures in °C (353.15 K → 80)."""
    return number * DIMENSIONS[UNIT_DIMENSION[unit]][unit] + ZERO.get(unit, 0.0)


def an(dimension: str) -> str:
    """``a length``, ``an angle``."""
    return f"{'an' if dimension[0] in 'aeiou' else 'a'} {dimension}"


def unit_of(dimension: str) -> str:
    """The unit in which reports print a dimension (``cm`` for a length); "" if it has none."""
    return _PREFERRED.get(dimension, ("", 3))[0]


def in_unit(value: float, dimension: str) -> float:
    """An SI value in the unit that reports print (0.08 m → 8.0 cm)."""
    unit = unit_of(dimension)
    return value / DIMENSIONS[dimension][unit] if unit else value


def format_quantity(value: float, dimension: str, more: int = 0) -> str:
    """An SI value as people read it: 0.0799 m → ``"8.0 cm"``; below 1 mm, in mm.

    ``more``: digits besides the usual ones.
    """
    unit, digits = _PREFERRED.get(dimension, ("", 3))
    if dimension == "length" and 0 < abs(value) < 1e-3:
        unit, digits = "mm", 2
    if not math.isfinite(value):
        return "∞" if value > 0 else "−∞" if value < 0 else "unknown"
    if dimension == "number":
        return f"{value:.{6 + more}g}"
    shown = value / DIMENSIONS[dimension][unit] if unit else value
    return f"{shown:.{digits + more}f} {unit}".rstrip()


def told_apart(value: float, limit: float, dimension: str) -> tuple[str, str]:
    """Two SI values with as many digits as it takes to see that they differ, up to six more."""
    for more in range(7):
        found = format_quantity(value, dimension, more), format_quantity(limit, dimension, more)
        if found[0] != found[1] or value == limit:
            break
    return found
