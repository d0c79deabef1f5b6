"""Mistakes that are put into sound campaigns are found, each is named by its code, and sound ones are quiet."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
import pytest
from seeded_campaigns import EVALUATION, sound

from safestage_eval.audit import choose
from safestage_eval.audit.audit import audit_campaign
from safestage_eval.audit.campaign_groups import apart, twins
from safestage_eval.audit.campaign_summary import Campaign
from safestage_eval.metrics.power import power_of, smallest_difference

CHECKS = [one for one in choose() if one.of == "evaluation"]


def found(campaign):
    if not isinstance(campaign, Campaign):
        campaign = Campaign(campaign)
    return audit_campaign(campaign, CHECKS)


@pytest.mark.parametrize("name", EVALUATION)
def test_a_mistake_is_found_and_rightly_named(name):
    seeded = EVALUATION[name]
    random = np.random.default_rng([zlib.crc32(name.encode()), 0])
    findings = found(seeded.put(sound(0), random))
    codes = {finding.code for finding in findings}
    assert seeded.code in codes, findings
    follows = "AUD351"  # what moves a rate makes a difference
    assert codes <= {seeded.code, follows, *seeded.also}, [
        f for f in findings if f.code != seeded.code
    ]
    for finding in findings:
        assert finding.what.endswith("."), finding
        assert finding.fix, finding


@pytest.mark.parametrize("seed", range(5))
def test_a_sound_campaign_has_no_finding(seed):
    assert found(sound(seed)) == []


def test_every_check_has_a_mistake_that_it_finds():
    assert {one.code for one in CHECKS} == {seeded.code for seeded in EVALUATION.values()}
    assert len(EVALUATION) >= 20


def test_an_empty_campaign_and_a_single_episode_are_no_reason_to_fail():
    assert found([]) == []
    assert {finding.code for finding in found(sound()[:1])} <= {"AUD352"}


@pytest.mark.parametrize("order", range(2))
def test_the_order_of_the_episodes_changes_no_finding_s_code(order):
    random = np.random.default_rng(order)
    for name in ("two seeds begin alike", "copied and written anew", "a deterministic policy"):
        campaign = EVALUATION[name].put(sound(), np.random.default_rng(1))
        shuffled = [campaign[i] for i in random.permutation(len(campaign))]
        assert {f.code for f in found(campaign)} == {f.code for f in found(shuffled)}


def test_a_quaternion_and_its_negative_are_one_state():
    one = sound()[0]
    (name, pose), *rest = one.start
    turned = replace(one, start=((name, (*pose[:3], *(-v for v in pose[3:]))), *rest))
    assert apart(one, turned)[0] == 0


def test_twins_are_those_of_all_pairs():
    random = np.random.default_rng(3)
    some = sound()[:20]
    some += [
        replace(e, episode_id=f"x{i}", waypoints=(e.places + np.float32(shift)).tobytes())
        for i, (e, shift) in enumerate(
            zip(some, random.choice([0, 5e-5, 2e-4, 1e-2], 20), strict=True)
        )
    ]
    pairs = {tuple(sorted((a.episode_id, b.episode_id))) for a, b in twins(some, 1e-4)}
    wanted = {
        tuple(sorted((a.episode_id, b.episode_id)))
        for i, a in enumerate(some)
        for b in some[i + 1 :]
        if a.duration == b.duration and np.abs(a.places - b.places).max() <= 1e-4
    }
    assert pairs == wanted and wanted


@pytest.mark.parametrize(("n", "m"), [(5, 5), (20, 20), (20, 50), (100, 100)])
@pytest.mark.parametrize("centre", [0.1, 0.5, 0.9])
def test_the_smallest_difference_is_shown_four_times_out_of_five(n, m, centre):
    least = smallest_difference(n, m, centre)
    middle = min(max(centre, least / 2), 1 - least / 2)
    p, q = middle - least / 2, middle + least / 2
    assert power_of(n, m, p, q) >= 0.8 - 1e-9
    random = np.random.default_rng(0)
    a, b = random.binomial(n, p, 20000), random.binomial(m, q, 20000)
    pooled = (a + b) / (n + m)
    z = np.abs(a / n - b / m) / np.sqrt(np.maximum(pooled * (1 - pooled), 1e-12) * (1 / n + 1 / m))
    assert np.mean(z > 1.959964) == pytest.approx(power_of(n, m, p, q), abs=0.015)


def test_more_rollouts_show_smaller_differences():
    sizes = [10, 20, 50, 100, 200, 400, 401, 1000]
    least = [smallest_difference(n, n, 0.5) for n in sizes]
    assert least == sorted(least, reverse=True) or np.all(np.diff(least) < 0.005)
    assert smallest_difference(1, 1, 0.5) is None
