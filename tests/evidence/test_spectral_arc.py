"""SPARC: the length of a spectrum that is known, and what must not change it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from safestage_eval.evidence.interval_arithmetic import CUTOFF, SHARE, sparc


def bell(t, middle: float, width: float):
    return np.exp(-0.5 * ((t - middle) / width) ** 2)


@pytest.mark.parametrize("width", [0.1, 0.2, 0.35])
@pytest.mark.parametrize("rate", [50.0, 120.0])
def test_a_bell_has_the_length_of_its_spectrum(width, rate) -> None:
    """The spectrum of exp(−t²/2w²) is exp(−2π²w²f²): it falls to 5 % at a known frequency."""
    t = np.arange(0, 6, 1 / rate)
    end = min(np.sqrt(-np.log(SHARE) / 2) / (np.pi * width), CUTOFF)

    def along(f: float) -> float:
        slope = -4 * np.pi**2 * width**2 * f * np.exp(-2 * (np.pi * width * f) ** 2)
        return float(np.hypot(1 / end, slope))

    assert sparc(bell(t, 3, width), 1 / rate) == pytest.approx(-quad(along, 0, end)[0], rel=0.01)


@settings(deadline=None, max_examples=40)
@given(st.floats(0.01, 100), st.floats(1.5, 4.5))
def test_neither_size_nor_moment_matters(size, middle) -> None:
    t = np.arange(0, 6, 0.01)
    plain = sparc(bell(t, 3, 0.2), 0.01)
    assert sparc(size * bell(t, middle, 0.2), 0.01) == pytest.approx(plain, rel=1e-3)


def test_more_stops_are_less_smooth() -> None:
    t = np.arange(0, 8, 0.01)
    found = [
        sparc(sum(bell(t, 1 + 1.2 * i, 0.2) for i in range(stops)), 0.01) for stops in (1, 2, 3, 4)
    ]
    assert found == sorted(found, reverse=True)
    assert found[-1] < found[0] - 1
