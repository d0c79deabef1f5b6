"""The worst level at which a violation would still be one."""

import pytest
from test_witness import pushed, scored


@pytest.mark.parametrize(
    ("gap", "expected"),
    [
        (0.085, ("pass", None)),
        (0.06, ("violation", None)),
        (0.03, ("violation", "serious")),
        (0.005, ("violation", "critical")),
    ],
)
def test_the_worst_level_is_named(gap: float, expected: tuple[str, str | None]) -> None:
    """ETS201 asks for 8 cm; below 4 cm is serious, below 1 cm critical, and serious as well."""
    (found,) = scored(pushed(0.4 - gap)).assigned
    assert (found.verdict, found.severity) == expected
    assert found.limit == pytest.approx(0.08)  # the rule's own, whatever the level
