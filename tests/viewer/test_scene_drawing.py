"""What is drawn is where the numbers say it is."""

import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from moving import path_of, pushed

from safestage_eval.viewer.episode.episode_section import StoredVerdicts, looks, section
from safestage_eval.viewer.episode.scene_drawing import Sight, outlines, scene
from safestage_eval.viewer.episode.svg import Scale, short, ticks
from safestage_eval.viewer.episode.timeline import LEFT, RIGHT, WIDTH, timeline


@pytest.fixture
def again(tmp_path):
    return pushed(tmp_path)


def looked(again, code):
    return looks(again, again.rules.rules[code], again.base(again.rules.rules[code])[1])


def test_a_rule_looked_at_what_it_compares(again):
    found = looked(again, "ETS901")
    (curve,) = found.curves
    (bound,) = curve.limits
    assert curve.signal == "displacement(cube)"
    assert (bound.value, bound.bad, bound.param) == (0.02, "above", "push")
    assert curve.series.value == pytest.approx(path_of(again.episode.t), abs=1e-6)
    assert found.judged == ((0, 180),)


def test_the_bad_side_of_what_is_required_is_the_other_one(again):
    found = {curve.signal: curve.limits[0] for curve in looked(again, "ETS902").curves}
    assert found["height(cube)"].bad == "below"
    assert found["displacement(cube)"].bad == "above"
    assert found["displacement(cube)"].param is None


def test_the_decisive_measurement_comes_first(again):
    verdict = again.base(again.rules.rules["ETS902"])[1]
    assert looked(again, "ETS902").curves[0].signal == verdict.signal


def points(path):
    return [tuple(map(float, pair.split())) for pair in re.findall(r"[ML]([-\d.]+ [-\d.]+)", path)]


def test_the_curve_goes_through_the_values(again):
    t = again.episode.t
    rule = again.rules.rules["ETS901"]
    drawn = timeline(t, looked(again, "ETS901"), again.base(rule)[1], None)
    (path,) = re.findall(r'class="curve" d="([^"]*)"', drawn)
    assert path.count("M") == 1  # known throughout
    at = np.array(points(path))
    time = (at[:, 0] - LEFT) / (WIDTH - RIGHT - LEFT) * t[-1]
    (limit,) = map(float, re.findall(r'class="limit" x1="\d+" y1="([\d.]+)"', drawn))
    ground = at[0, 1]  # where the displacement is 0
    value = (ground - at[:, 1]) / (ground - limit) * 0.02
    assert value == pytest.approx(path_of(time), abs=1.5e-3)  # a tenth of a pixel, as drawn
    (bad,) = re.findall(r'class="bad" x="([\d.]+)"', drawn)
    crossing = (float(bad) - LEFT) / (WIDTH - RIGHT - LEFT) * t[-1]
    assert path_of(crossing) == pytest.approx(0.02, abs=0.002)


def test_a_spike_of_one_frame_is_drawn(again):
    """Thinning out keeps extremes."""
    from dataclasses import replace

    from safestage_eval.evidence.series import exact

    t = np.arange(20_000) / 120
    values = np.zeros(len(t))
    values[12_345] = 0.5
    found = looked(again, "ETS901")
    curve = replace(found.curves[0], series=exact(values, "length"))
    verdict = again.base(again.rules.rules["ETS901"])[1]
    drawn = timeline(t, replace(found, curves=(curve,), judged=((0, len(t)),)), verdict, None)
    (path,) = re.findall(r'class="curve" d="([^"]*)"', drawn)
    heights = {y for _, y in points(path)}
    assert len(heights) == 2


def test_outlines_are_the_shapes_as_seen(again):
    episode = again.episode
    (seen,) = outlines(episode, "cube", 179, "xy")
    assert seen.points.min(axis=0) == pytest.approx([0.03, -0.03], abs=1e-6)
    assert seen.points.max(axis=0) == pytest.approx([0.09, 0.03], abs=1e-6)
    (seen,) = outlines(episode, "cube", 0, "xz")
    assert sorted(map(tuple, seen.points.round(3))) == [(-0.03, 0), (-0.03, 0.06), (0.03, 0), (0.03, 0.06)]  # fmt: skip
    assert outlines(episode, "cube", 0, "xz", (1.0, 2.0, 0.0, 1.0)) == []
    table, cube = (Sight(episode, "xy").of(name, 0)[0] for name in ("table", "cube"))
    assert table.depth > cube.depth  # seen from above the table is behind


def test_the_scene_names_what_the_finding_is_about_and_shows_where_it_was(again):
    drawn = scene(again.episode, 179, ("cube", "robot"))
    assert drawn.count("<svg") == 2
    assert drawn.count('class="b named"') == 2
    assert drawn.count('class="b was"') == 2
    assert drawn.count(">cube</text>") == 2
    assert 'class="b was"' not in scene(again.episode, 0, ("cube",))


def test_a_section_tells_the_gravest_first_and_where_results_differ(again):
    html, differs = section(
        again, StoredVerdicts({"ETS901": ("pass", ""), "ETS902": ("pass", "0" * 64)})
    )
    assert html.index("ETS901") < html.index("Key frame")
    assert differs[0].startswith("The results say pass of ETS901")
    assert differs[1] == "The results were made under another meaning of ETS902."
    same = {
        rule.code: (v.verdict, v.rule_digest)
        for rule in again.assigned
        for v in [again.base(rule)[1]]
    }
    assert section(again, StoredVerdicts(same))[1] == ()


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 9))
def test_ticks_are_inside_even_and_not_too_many(low, span, about):
    found = ticks(low, low + span, about)
    assert all(low - 1e-6 * span <= tick <= low + span * (1 + 1e-6) for tick in found)
    assert len(found) <= about + 2
    assert len({round(b - a, 9) for a, b in pairwise(found)}) <= 2


@given(st.floats(0, 100), st.floats(0, 100))
def test_a_scale_keeps_order_and_stays_within_its_ends(a, b):
    scale = Scale(0, 100, 400, 20)
    assert 20 <= scale(a) <= 400
    assert (scale(a) >= scale(b)) == (a <= b) or scale(a) == scale(b)


@pytest.mark.parametrize(
    ("value", "said"), [(1.0, "1"), (-0.04, "0"), (1.25, "1.2"), (300, "300"), (0.5, "0.5")]
)
def test_coordinates_are_short(value, said):
    assert short(value) == said
