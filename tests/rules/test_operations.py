"""Dimensions of derived signals follow from those of their operands, or are refused."""

import pytest

from safestage_eval.rules.operations import OPERATIONS, DimensionError, dimension_of_result
from safestage_eval.units import (
    DIMENSIONS,
    UNIT_DIMENSION,
    dimension_of_powers,
    in_si,
    powers_of,
    unit_of,
)


@pytest.mark.parametrize(
    ("operation", "given", "found"),
    [
        ("difference", ["length", "length"], "length"),
        ("sum", ["number", "ratio"], "number"),
        ("derivative", ["length"], "speed"),
        ("derivative", ["speed"], "acceleration"),
        ("derivative", ["acceleration"], "jerk"),
        ("derivative", ["angle"], "rate"),
        ("derivative", ["rate"], "angular acceleration"),
        ("derivative", ["angular acceleration"], "angular jerk"),
        ("derivative", ["force"], "force rate"),
        ("derivative", ["temperature"], "heating"),
        ("derivative", ["ratio"], "frequency"),
        ("derivative", ["impulse"], "force"),
        ("integral", ["speed"], "length"),
        ("integral", ["jerk"], "acceleration"),
        ("integral", ["rate"], "angle"),
        ("integral", ["force"], "impulse"),
        ("integral", ["length"], "stay"),
        ("integral", ["ratio"], "time"),
        ("product", ["length", "length"], "area"),
        ("product", ["force", "speed"], "power"),
        ("product", ["force", "length"], "torque"),
        ("product", ["ratio", "force"], "force"),
        ("product", ["ratio", "ratio"], "ratio"),
        ("product", ["number", "ratio"], "number"),
        ("magnitude", ["force", "force", "force"], "force"),
        ("abs", ["angle"], "angle"),
        ("min", ["temperature", "temperature"], "temperature"),
        ("quotient", ["length", "length"], "ratio"),
        ("quotient", ["number", "ratio"], "number"),
        ("quotient", ["power", "force"], "speed"),
        ("product", ["jerk", "jerk"], "squared jerk"),
        ("root", ["squared jerk"], "jerk"),
        ("root", ["area"], "length"),
        ("root", ["ratio"], "ratio"),
        ("integral", ["squared jerk"], "integrated squared jerk"),
        ("integral", ["squared angular jerk"], "integrated squared angular jerk"),
        ("sparc", ["speed"], "number"),
        ("sparc", ["rate"], "number"),
        ("holds", ["ratio"], "ratio"),
    ],
)
def test_the_dimension_of_a_result(operation, given, found):
    assert dimension_of_result(operation, given) == found


@pytest.mark.parametrize(
    ("operation", "given"),
    [
        ("sum", ["length", "force"]),
        ("max", ["speed", "rate"]),
        ("difference", ["angle", "ratio"]),
        ("product", ["temperature", "ratio"]),
        ("integral", ["temperature"]),
        ("product", ["force", "force"]),
        ("derivative", ["jerk"]),
        ("integral", ["angle"]),
        ("root", ["length"]),
        ("root", ["speed"]),
        ("quotient", ["temperature", "time"]),
        ("sparc", ["temperature"]),
    ],
)
def test_what_has_no_dimension_is_refused(operation, given):
    with pytest.raises(DimensionError) as refused:
        dimension_of_result(operation, given)
    assert refused.value.what.startswith(operation)
    assert refused.value.allowed


def test_every_dimension_is_made_of_its_units() -> None:
    """No two are made alike but plain numbers and ratios; each unit is of one, and reports print one."""
    made = [tuple(sorted(powers_of(name).items())) for name in DIMENSIONS]
    assert len(made) == len({*made}) + 1
    for name, units in DIMENSIONS.items():
        assert dimension_of_powers(powers_of(name)) in (name, "ratio")
        assert name == "number" or unit_of(name) in units
        for unit in units:
            assert UNIT_DIMENSION[unit] == name
    assert in_si(5, "cm/s^2") == pytest.approx(0.05)


def test_a_derivative_undoes_an_integral() -> None:
    for name in DIMENSIONS:
        try:
            over_time = dimension_of_result("integral", [name])
        except DimensionError:
            continue
        back = dimension_of_result("derivative", [over_time])
        assert powers_of(back) == powers_of(name)


def test_every_operation_says_what_it_takes() -> None:
    for spec in OPERATIONS.values():
        assert 1 <= spec.least <= spec.most
        assert spec.meaning.endswith(".")
