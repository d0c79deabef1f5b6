"""The browser shows the evidence of an episode's verdicts."""

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from moving import path_of, pushed

from safestage_eval.evidence.series import exact
from safestage_eval.units import in_unit
from safestage_eval.verdicts.curves import Curve
from safestage_eval.viewer.campaign.svg import Scale, short, ticks
from safestage_eval.viewer.episode.episode_data import episode_data, looks
from safestage_eval.viewer.episode.measured_curves import curve_data, runs, spans_of
from safestage_eval.viewer.episode.stored_verdicts import StoredVerdicts, differences


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


def head(data):
    size = int.from_bytes(data[:4], "little")
    return json.loads(data[4 : 4 + size])


def test_the_curve_has_the_values_and_the_limit_in_one_unit(again):
    curve = curve_data(np.asarray(again.episode.t, float), looked(again, "ETS901").curves[0])
    cm = in_unit(1.0, "length")
    assert curve["unit"] == "cm"
    assert curve["least"] is None
    assert curve["limits"] == [{"value": 0.02 * cm, "bad": "above", "said": "push 2.0 cm"}]
    known = [(t, v) for t, v in zip(curve["t"], curve["v"], strict=True) if v is not None]
    times, values = map(np.array, zip(*known, strict=True))
    assert values / cm == pytest.approx(path_of(times), abs=1e-4)
    assert (times[0], times[-1]) == pytest.approx(
        (again.episode.t[0], again.episode.t[-1]), abs=1e-3
    )


def test_a_spike_of_one_frame_is_kept(again):
    """Thinning out keeps extremes."""
    t = np.arange(20_000) / 120
    values = np.zeros(len(t))
    values[12_345] = 0.5
    curve = curve_data(t, Curve("displacement(cube)", exact(values, "length"), ()))
    assert len(curve["t"]) < 1000
    assert max(curve["v"]) == in_unit(0.5, "length")
    assert curve["t"][int(np.argmax(curve["v"]))] == pytest.approx(t[12_345], abs=1e-3)


def test_what_a_finding_names_is_kept():
    """A value that is no extreme, at the moment that the verdict tells."""
    t = np.arange(20_000) / 120
    values = np.where(np.arange(len(t)) % 2, 0.5, 0.0)
    values[12_345] = 0.25
    curve = Curve("displacement(cube)", exact(values, "length"), ())
    thin = curve_data(t, curve)
    assert in_unit(0.25, "length") not in thin["v"]
    kept = curve_data(t, curve, (None, float(t[12_345]), 1e9))
    at = kept["v"].index(in_unit(0.25, "length"))
    assert kept["t"][at] == pytest.approx(t[12_345], abs=1e-3)
    assert kept["t"] == sorted(kept["t"])


def test_what_was_not_measured_breaks_the_curve(again):
    t = np.arange(1200) / 120
    values = np.sin(t)
    values[400:800] = np.nan
    curve = curve_data(t, Curve("height(cube)", exact(values, "length"), ()))
    inside = [v for at, v in zip(curve["t"], curve["v"], strict=True) if 3.33 < at < 6.66]
    assert inside == [None]


@given(st.lists(st.booleans(), min_size=1, max_size=60))
def test_runs_are_where_it_is_true(true):
    mask = np.array(true)
    back = np.zeros(len(mask), bool)
    for a, b in runs(mask):
        assert a < b
        back[a:b] = True
    assert (back == mask).all()
    spans = spans_of(np.arange(len(mask)) / 10, runs(mask))
    assert all(a <= b for a, b in spans)


def test_the_evidence_says_what_the_verdicts_say(again):
    said = head(episode_data(again))
    found = {finding["rule"]: finding for finding in said["findings"]}
    for rule in again.assigned:
        verdict = again.base(rule)[1]
        finding = found[rule.code]
        assert finding["verdict"] == verdict.verdict
        assert finding["text"] == verdict.explanation
        assert finding["intervals"] == [list(pair) for pair in verdict.intervals]
        assert (finding["time"], finding["worst"]) == (verdict.time, verdict.worst_time)
        assert finding["curves"][0]["signal"] == verdict.signal
    order = [finding["verdict"] for finding in said["findings"]]
    assert order == sorted(order, key=["violation", "inconclusive", "pass", "not_applicable"].index)
    assert said["roles"] == {
        role: list(names) for role, names in again.binding.roles.items() if names
    }
    assert [phase["name"] for phase in said["phases"]][:1] == ["execution"]


def test_meshes_that_are_shared_are_kept_apart_once(again):
    shared = {}
    alone, without = episode_data(again), episode_data(again, shared=shared)
    assert len(without) <= len(alone)
    assert set(shared) <= {mesh.get("key") for mesh in head(without[4 + int.from_bytes(without[:4], "little") :])["meshes"]}  # fmt: skip


def test_where_results_differ_is_said(again):
    verdicts = [again.base(rule)[1] for rule in again.assigned]
    stored = StoredVerdicts({"ETS901": ("pass", ""), "ETS902": ("pass", "0" * 64)})
    differs = differences(verdicts, stored)
    assert differs[0].startswith("The results say pass of ETS901")
    assert differs[1] == "The results were made under another meaning of ETS902."
    assert head(episode_data(again, stored))["differs"] == list(differs)
    same = StoredVerdicts({v.rule: (v.verdict, v.rule_digest) for v in verdicts})
    assert differences(verdicts, same) == ()


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
