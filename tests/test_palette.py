"""Colours can be read: contrast by WCAG 2.2; colour-blind readers can distinguish verdicts and roles."""

import re

import numpy as np
import pytest

from safestage_eval.palette import PAINTS, SIGNS, custom_properties
from safestage_eval.palette import VERDICTS as VERDICT_INKS
from safestage_eval.viewer.html_page import part

PAIRS = {
    name: (light, dark)
    for name, light, dark in re.findall(
        r"--([\w-]+): light-dark\((#\w{6}), (#\w{6})\)", custom_properties()
    )
}
GROUNDS = ("ground", "surface", "sunken")
VERDICTS = ("pass", "violation", "inconclusive", "not-applicable")

MACHADO = {  # Machado, Oliveira & Fernandes 2009, severity 1
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


def linear(colour):
    """(3,) linear RGB of #rrggbb."""
    s = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def contrast(one, other):
    """WCAG's contrast ratio."""
    light, dark = sorted(float(linear(c) @ [0.2126, 0.7152, 0.0722]) for c in (one, other))[::-1]
    return (light + 0.05) / (dark + 0.05)


def lab(rgb):
    """CIELAB (D65) of linear RGB."""
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = np.cbrt(np.clip(xyz @ rgb / [0.9505, 1.0, 1.089], 1e-6, None))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("dark", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("ink", ["ink", "ink-soft", "accent", *VERDICTS])
def test_text_can_be_read_on_every_ground(ink, dark):
    for ground in GROUNDS:
        assert contrast(PAIRS[ink][dark], PAIRS[ground][dark]) >= 4.5, ground


@pytest.mark.parametrize("dark", [0, 1], ids=["light", "dark"])
def test_marks_and_borders_of_controls_are_seen(dark):
    marks = [name for name in PAIRS if name.startswith(("series-", "line-", "safe-", "unsafe-"))]
    assert len(marks) >= 9
    for name in marks:
        for ground in GROUNDS:
            assert contrast(PAIRS[name][dark], PAIRS[ground][dark]) >= 3, (name, ground)


@pytest.mark.parametrize("dark", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("sight", MACHADO)
def test_pass_and_violation_are_distinguished_by_colour_blind_readers(sight, dark):
    seen = [lab(np.clip(MACHADO[sight] @ linear(PAIRS[n][dark]), 0, 1)) for n in VERDICTS[:2]]
    assert np.linalg.norm(seen[0] - seen[1]) > 25  # CIE76; about 2 is just noticeable


def seen_by(sight, colour):
    """CIELAB of a colour as such a reader sees it."""
    return lab(np.clip(MACHADO[sight] @ linear(colour), 0, 1)) if sight else lab(linear(colour))


@pytest.mark.parametrize("sight", [None, *MACHADO])
def test_no_role_looks_like_a_violation(sight):
    violation = VERDICT_INKS["violation"].light
    for role, paint in PAINTS.items():
        away = np.linalg.norm(seen_by(sight, paint) - seen_by(sight, violation))
        assert away > 20, role  # CIE76; about 2 is just noticeable


def test_every_verdict_has_a_sign_of_its_own():
    assert SIGNS.keys() == VERDICT_INKS.keys()
    assert len(set(SIGNS.values())) == len(SIGNS)
    for verdict, sign in SIGNS.items():
        assert f'.verdict.{verdict}::before {{ content: "{sign}" / ""; }}' in part("theme.css")
