"""Rounding shows in the numbers of a column, and is no contradiction; whatever is more is one."""

from dataclasses import replace

import numpy as np
import pytest
from rounded import in_steps, to_bits, to_digits, to_float16, to_steps, with_columns
from scenes import G, Scene
from told import doubt_of

from safestage_eval.doubts import contradictions
from safestage_eval.episode.invariants import check
from safestage_eval.episode.rounding import rounding_of
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

RNG = np.random.default_rng(7)
MANY = (5 * RNG.normal(size=(4000, 3))).astype(np.float32)


@pytest.mark.parametrize(
    ("by", "share", "step"),
    [
        (lambda v: v, 2.0**-23, 0),
        (to_float16, 2.0**-10, 0),
        (to_bits, 2.0**-10, 0),
        (lambda v: to_bits(v, 8), 2.0**-7, 0),
        (to_digits, 0.01, 0),
        (lambda v: to_digits(v, 4), 0.001, 0),
        (to_steps, 2.0**-23, 1 / 32),
        (lambda v: to_steps(v, 0.01), 2.0**-23, 0.01),
        (lambda v: to_steps(v, 0.0122), 2.0**-23, 0.0122),
        (lambda v: v * 0, 2.0**-23, 0),
        (lambda v: v[:0], 2.0**-23, 0),
    ],
)
@pytest.mark.parametrize("gaps", [False, True])
def test_a_column_shows_how_it_was_rounded(by, share, step, gaps):
    values = by(MANY).copy()
    if gaps:
        values[::5] = np.nan
    found = rounding_of(values)
    assert found.share == pytest.approx(share)
    assert found.step == pytest.approx(step)
    if np.nan_to_num(values).any():
        off = np.abs(values - MANY)
        assert not (off > 1.001 * found.error(MANY)).any()


@pytest.mark.parametrize("values", [(5.0,), (0.5, 1.0), (1.0, 2.0, 3.0)])
def test_few_round_numbers_show_hardly_anything(values):
    found = rounding_of(np.array(values, np.float32))
    assert found.error(max(values)) <= max(values) / 32


def pressed(peak, mass=1.0, weight=G):
    """Codes of contradictions of a box on a table, whose force grows; ``peak``: of the force (N,)."""
    scene = Scene(240).fixed("table").box("a", 0.05, (0, 0, 0.05), mass=mass)
    for i, share in enumerate(np.linspace(0.9, 1.1, 240)):
        scene.rests("a", "table", 0.05, (0, 0, 0), weight * share, frames=slice(i, i + 1))
    episode = scene.episode()
    table = episode.contacts
    force = np.bincount(table.frame, table.force[:, 2])[table.frame].astype(np.float32)
    return with_columns(episode, peak_force=peak(force))


@pytest.mark.parametrize(
    ("peak", "codes"),
    [
        (lambda f: f, []),
        (lambda f: to_steps(f - 1 / 64), []),
        (lambda f: to_steps(f / 4 - 1 / 64), ["AUD124"]),
        (lambda f: f * 0.97, ["AUD124"]),
        (lambda f: to_bits(f * 0.97), ["AUD124"]),
        (lambda f: f / 4, ["AUD124"]),
    ],
)
def test_a_peak_is_below_the_force_by_rounding_alone(peak, codes):
    episode = pressed(peak, mass=0.1, weight=G / 10)
    assert [e.code for e in contradictions(episode)] == codes


def test_a_light_body_is_borne_by_forces_that_were_rounded_to_nothing():
    """5 g on four corners: 0.012 N each, in steps of 1/32 N."""
    scene = Scene(240).fixed("table").box("light", 0.05, (0, 0, 0.05), mass=0.005)
    scene.rests("light", "table", 0.05, (0, 0, 0), 0.005 * G)
    scene.box("heavy", 0.05, (0.3, 0, 0.05)).rests("heavy", "table", 0.05, (0.3, 0, 0), G)
    coarse = in_steps(scene.episode())
    assert not [*contradictions(coarse)]
    relations = Relations(Signals(coarse))
    for name in ("light", "heavy"):
        assert (relations.told("supported", (name,)).upper == 1).all()
    assert doubt_of(relations, "supported", ("light",))[0].all()
    doubt = doubt_of(relations, "supported", ("heavy",))
    assert doubt is None or not doubt[0].any()


@pytest.mark.parametrize(("times", "problems"), [(1.0, 0), (1.05, 1)])
def test_quaternions_in_steps_of_one_byte_are_of_unit_norm(times, problems):
    half = np.linspace(0, 0.5, 60)
    turn = np.column_stack([np.cos(half), 0 * half, 0 * half, np.sin(half)])
    scene = Scene(60).fixed("table").box("a", 0.05, (0, 0, 0.05), orientation=turn)
    episode = scene.episode()
    track = episode.tracks["a"]
    coarse = replace(track, orientation=to_steps(times * track.orientation, 1 / 127))
    found = check(replace(episode, tracks={**episode.tracks, "a": coarse}))
    assert len(found) == problems


def test_forces_along_a_surface_do_not_pull_for_being_rounded():
    """5 N at nearly right angles to the normal, in steps of 1/32 N."""
    scene = Scene(60).fixed("table").box("a", 0.05, (0, 0, 0.05))
    for i, angle in enumerate(np.linspace(0.01, 1.5, 60)):
        normal = (np.sin(angle), 0, np.cos(angle))
        force = (5 * np.cos(angle - 0.002), 0, -5 * np.sin(angle - 0.002))
        scene.contact("table", "a", (0, 0, 0), force, normal, slice(i, i + 1))
    table = (episode := in_steps(scene.episode())).contacts
    assert ((table.force * table.normal).sum(axis=1) < -0.007).any()
    for force, known in ((table.force, True), (to_steps(-table.normal), False)):
        found = Signals(with_columns(episode, force=force)).get("contact_force", ("a", "table"))
        assert np.isfinite(found.upper).all() == known
