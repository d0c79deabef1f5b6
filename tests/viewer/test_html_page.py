"""The theme can be read: contrast by WCAG 2.2, and verdicts told apart by colour-blind readers."""

import re

import numpy as np
import pytest

from safestage_eval.palette import custom_properties
from safestage_eval.viewer.html_page import page, part

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


def test_the_measure_of_contrast_is_the_known_one():
    assert contrast("#ffffff", "#000000") == pytest.approx(21)
    assert contrast("#767676", "#ffffff") == pytest.approx(4.54, abs=0.01)


@pytest.mark.parametrize("dark", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("ink", ["ink", "ink-soft", "accent", *VERDICTS])
def test_text_can_be_read_on_every_ground(ink, dark):
    for ground in GROUNDS:
        assert contrast(PAIRS[ink][dark], PAIRS[ground][dark]) >= 4.5, ground


@pytest.mark.parametrize("dark", [0, 1], ids=["light", "dark"])
def test_text_can_be_read_on_its_own_soft_ground(dark):
    for name in ("accent", *VERDICTS):
        assert contrast(PAIRS[name][dark], PAIRS[f"{name}-soft"][dark]) >= 4.5, name
        assert contrast(PAIRS["ink"][dark], PAIRS[f"{name}-soft"][dark]) >= 4.5, name
    assert contrast(PAIRS["on-accent"][dark], PAIRS["accent"][dark]) >= 4.5


@pytest.mark.parametrize("dark", [0, 1], ids=["light", "dark"])
def test_marks_and_borders_of_controls_are_seen(dark):
    marks = [name for name in PAIRS if name.startswith(("series-", "line-", "safe-", "unsafe-"))]
    assert len(marks) >= 9
    for name in marks:
        for ground in GROUNDS:
            assert contrast(PAIRS[name][dark], PAIRS[ground][dark]) >= 3, (name, ground)


@pytest.mark.parametrize("dark", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("sight", MACHADO)
def test_pass_and_violation_are_told_apart_by_colour_blind_readers(sight, dark):
    seen = [lab(np.clip(MACHADO[sight] @ linear(PAIRS[n][dark]), 0, 1)) for n in VERDICTS[:2]]
    assert np.linalg.norm(seen[0] - seen[1]) > 25  # CIE76; about 2 is just noticeable


def test_every_token_that_is_used_exists():
    text = custom_properties() + part("theme.css")
    defined = set(re.findall(r"--([\w-]+):", text))
    assert set(re.findall(r"var\(--([\w-]+)\)", text)) <= defined


def test_a_page_names_its_scripts_and_styles_by_hash_and_allows_nothing_else():
    html = page("A <title>", ["<p>hello</p>"], styles=["p { color: red }"], scripts=["void 0;"])
    policy = re.search(r'Security-Policy" content="([^"]*)"', html)[1]
    assert "default-src &#x27;none&#x27;" in policy
    assert policy.count("sha256-") == 5
    assert "unsafe" not in policy
    assert "A &lt;title&gt;" in html
    assert not re.search(r'(?:src|href)="(?!data:)', html)
