"""Changes of a recording that leave what happened change no verdict.

The laws hold for every recorded episode and every built-in rule, whichever they are; a share is tried.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import transforms
from sampled import share

from safestage_eval.episode import Episode
from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import EpisodeResult, judge

TRACES = Path(__file__).parent.parent / "traces"
EPISODES = {ref.episode_id.partition(".default")[0]: ref for ref in discover([TRACES])}


def episodes(law: str) -> pytest.MarkDecorator:
    """A sixth of the episodes, for each law others."""
    return pytest.mark.parametrize("name", share(sorted(EPISODES), 6, of=law))


@cache
def rules():
    return load_rules(["ish", "ets", "fsh"])


@cache
def recorded(name: str) -> Episode:
    return EPISODES[name].open()


@cache
def judged(name: str) -> EpisodeResult:
    return judge(recorded(name), rules())


def judge_(episode: Episode) -> EpisodeResult:
    return judge(episode, rules(), trace_hash="changed")


def same(
    before: EpisodeResult, after: EpisodeResult, frames: float, back=lambda name: name
) -> None:
    """Equal verdicts; times within so many frames (s), values within rounding of float32."""
    assert after.success == before.success
    assert before.success_time == pytest.approx(after.success_time, abs=frames)
    for old, new in zip(before.verdicts, after.verdicts, strict=True):
        assert (new.rule, new.verdict, new.severity) == (old.rule, old.verdict, old.severity)
        assert new.instances == old.instances, old.rule
        assert new.consequence_of == old.consequence_of
        assert (new.time is None) == (old.time is None)
        if old.time is not None:
            assert new.time == pytest.approx(old.time, abs=frames), old.rule
            assert sorted(map(back, new.bodies)) == sorted(old.bodies), old.rule


def same_values(before: EpisodeResult, after: EpisodeResult) -> None:
    for old, new in zip(before.verdicts, after.verdicts, strict=True):
        if old.value is None or not np.isfinite(old.value):
            continue
        if new.value is None:  # rounding has made it tie with another
            assert old.verdict == new.verdict == "pass"
            continue
        assert new.value == pytest.approx(old.value, rel=2e-3, abs=5e-5), old.rule
        assert new.limit == pytest.approx(old.limit)
        assert (new.margin is None) == (old.margin is None)
        if old.margin is not None:
            assert new.margin == pytest.approx(old.margin, rel=2e-3, abs=5e-5), old.rule


@episodes("moved")
@pytest.mark.parametrize(("yaw", "shift"), [(-0.7, (3.0, -1.5, 0.4))])
def test_where_the_scene_stands_and_which_way_it_faces(name, yaw, shift):
    after = judge_(transforms.moved(recorded(name), yaw, shift))
    same(judged(name), after, frames=1 / 120 + 1e-6)
    same_values(judged(name), after)


@episodes("renamed")
def test_what_the_bodies_are_called(name):
    """The names sort in the opposite order as well."""
    names = sorted(recorded(name).bodies)
    new = {old: f"thing_{len(names) - i:03d}" for i, old in enumerate(names)}
    old_name = {value: key for key, value in new.items()}
    after = judge_(transforms.renamed(recorded(name), new.__getitem__))
    same(judged(name), after, 1e-9, back=lambda body: old_name.get(body, body))
    same_values(judged(name), after)


@episodes("permuted")
def test_the_order_of_bodies_and_contacts(name):
    episode = recorded(name)
    draw = np.random.default_rng(4)
    order = draw.permutation(len(episode.header.bodies)).tolist()
    rows = draw.permutation(len(episode.contacts))
    after = judge_(transforms.permuted(episode, order, rows))
    same(judged(name), after, frames=1e-9)
    same_values(judged(name), after)


@episodes("rate")
def test_half_the_rate(name):
    """Every violation here lasts longer than two coarse frames; what flickers before it may not.

    Whether a touch that was too brief still is may then be left open.
    """
    before, after = judged(name), judge_(transforms.every_second(recorded(name)))
    listed = [
        new.verdict != "inconclusive" or not any("too brief" in note for note in old.notes)
        for old, new in zip(before.verdicts, after.verdicts, strict=True)
    ]
    before, after = (
        replace(x, verdicts=tuple(itertools.compress(x.verdicts, listed))) for x in (before, after)
    )
    same(before, after, frames=0.1)


@episodes("longer")
def test_a_recording_that_goes_on_after_the_hold(name):
    episode = recorded(name)
    assert episode.header.success
    after = judge_(transforms.gone_on(episode, 120))
    same(judged(name), after, frames=1e-9)
    same_values(judged(name), after)


@episodes("shorter")
@pytest.mark.parametrize("share", [0.45, 0.8])
def test_a_recording_that_breaks_off_is_judged_alike_or_not_at_all(name, share):
    """Lost evidence may leave a verdict open; it never turns one into another."""
    episode = recorded(name)
    cut = judge_(transforms.cut_off(episode, int(share * len(episode))))
    for whole, part in zip(judged(name).verdicts, cut.verdicts, strict=True):
        assert part.verdict in ("inconclusive", whole.verdict), (part.rule, part.notes)
        if part.verdict == "violation":
            assert part.time == pytest.approx(whole.time, abs=1e-9), part.rule
