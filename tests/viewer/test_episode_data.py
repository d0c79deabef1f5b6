"""The browser shows the evidence of an episode's verdicts."""

import json

import numpy as np
import pytest
from moving import path_of, pushed

from safestage_eval.evidence.intervals import exact
from safestage_eval.units import in_unit
from safestage_eval.verdicts.curves import Curve
from safestage_eval.viewer.episode.episode_data import differences, episode_data, looks
from safestage_eval.viewer.episode.measured_curves import curve_data


@pytest.fixture
def again(tmp_path):
    return pushed(tmp_path)


def looked(again, code):
    return looks(again, again.rules.rules[code], again.usual(again.rules.rules[code]))


def test_a_rule_looked_at_what_it_compares(again):
    found = looked(again, "ETS901")
    (curve,) = found.curves
    (bound,) = curve.limits
    assert curve.signal == "displacement(cube)"
    assert (bound.value, bound.bad, bound.param) == (0.02, "above", "push")
    assert curve.series.value == pytest.approx(path_of(again.episode.t), abs=1e-6)
    assert found.judged == ((0, 180),)


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


def test_the_evidence_says_what_the_verdicts_say(again):
    said = head(episode_data(again))
    found = {finding["rule"]: finding for finding in said["findings"]}
    for rule in again.assigned:
        verdict = again.usual(rule)
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


def test_where_results_differ_is_said(again):
    verdicts = [again.usual(rule) for rule in again.assigned]
    stored = {"ETS901": ("pass", ""), "ETS902": ("pass", "0" * 64)}
    differs = differences(verdicts, stored)
    assert differs[0].startswith("The results say pass of ETS901")
    assert differs[1] == "The results were made under another meaning of ETS902."
    assert head(episode_data(again, stored))["differs"] == list(differs)
    same = {v.rule: (v.verdict, v.rule_digest) for v in verdicts}
    assert differences(verdicts, same) == ()
