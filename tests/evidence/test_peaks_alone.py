"""Peaks that were not recorded leave open what is computed from them; peaks alone are no forces."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from resampled import resampled
from rounded import with_columns
from sampled import share
from scenes import Scene
from told import doubt_of, holds

from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import discover
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge

TRACES = Path(__file__).parents[2] / "traces"


def pressed(peak=np.nan, force=9.81):
    """A box of 1 kg on a table, at the first half of the frames with a force."""
    scene = Scene(60).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.rests("a", "table", 0.05, (0, 0, 0), 9.81, frames=slice(0, 30))
    scene.rests("a", "table", 0.05, (0, 0, 0), 0.0, frames=slice(30, 60))
    episode = scene.episode()
    rows = len(episode.contacts)
    peaks = np.full(rows, peak, np.float32)
    return with_columns(episode, peak_force=peaks, force=episode.contacts.force * (force / 9.81))


@pytest.mark.parametrize("asked_first", ["peak_force", "contact_force"])
def test_a_peak_that_is_nan_leaves_the_force_known(asked_first):
    relations = Relations(Signals(pressed()))
    relations.signal(asked_first, ("a", "table"))
    force, peak = (relations.signal(f"{x}_force", ("a", "table")) for x in ("contact", "peak"))
    assert force.known.all()
    assert not force.notes
    assert peak.lower == pytest.approx(force.lower)
    assert not np.isfinite(peak.upper).any()
    assert "peak force" in peak.notes[0]
    assert holds(relations, "supported", ("a",))[:30].all()
    assert doubt_of(relations, "supported", ("a",)) is None


def test_where_no_force_is_and_no_peak_nobody_knows_whether_they_touched():
    found = Signals(pressed()).get("impulse", ("a", "table"))
    assert np.isfinite(found.upper[:30]).all()
    assert not np.isfinite(found.upper[30:]).any()


@pytest.mark.parametrize("peak", [0.0, 9.81])
def test_zeros_are_no_recorded_forces_whatever_the_peaks(peak):
    signals = Signals(pressed(peak, force=0.0))
    assert not signals.get("contact_force", ("a", "table")).known.any()
    assert holds(Relations(signals), "supported", ("a",)).all()  # by geometry


def told(episode, rules, *, assigned_only=False):
    found = judge(replace(episode, path=None), rules, assigned_only=assigned_only)
    return {v.rule: v.verdict for v in found.verdicts}


@pytest.mark.slow
@pytest.mark.parametrize("part", ["ish_", "ets_", "fsh_"])
def test_recordings_without_some_peaks_keep_their_verdicts(part):
    """Those of the pairs with most rows are NaN: nothing here hangs on these."""
    rules = load_rules(["ish", "ets", "fsh"])
    for ref in share([ref for ref in discover(TRACES) if part in ref.episode_id], 8, of=part):
        episode = ref.open()
        table, peaks = episode.contacts, episode.contacts.peak_force.copy()
        for pair in sorted(table.pairs, key=lambda p: -len(table.rows(p)))[:5]:
            peaks[table.rows(pair)] = np.nan
        found = told(with_columns(episode, peak_force=peaks), rules)
        assert found == told(episode, rules), ref.episode_id


@pytest.mark.slow
def test_recordings_of_peaks_alone_are_judged_as_those_without_forces():
    rules = load_rules(["ish"])
    for ref in share([ref for ref in discover(TRACES) if "can_under_bottle" in ref.episode_id], 4):
        episode, none = resampled(whole := ref.open(), np.arange(0, len(whole), 6)), {}
        none["force"] = np.zeros_like(episode.contacts.force)
        alone = told(with_columns(episode, **none), rules, assigned_only=True)
        none["peak_force"] = np.zeros_like(episode.contacts.peak_force)
        assert alone == told(with_columns(episode, **none), rules, assigned_only=True)
        assert alone["ISH101"] != "not_applicable"
