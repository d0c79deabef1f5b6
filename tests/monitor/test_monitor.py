"""The monitor's verdicts during a rollout are the evaluator's of the trace up to then."""

from __future__ import annotations

from pathlib import Path

import pytest
from growing import growing
from resampled import cut_out
from sampled import share

from safestage_eval.episode import Episode
from safestage_eval.formats import discover
from safestage_eval.monitor import Monitor
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.verdicts import Verdict, judge

TRACES = Path(__file__).parents[2] / "traces"
RECORDED = {ref.episode_id or "": ref for ref in discover([TRACES])}
RULES = load_rules(builtin_names())


def violated(episode: Episode, *, assigned_only: bool) -> dict[str, Verdict]:
    found = judge(episode, RULES, trace_hash="", assigned_only=assigned_only)
    return {v.rule: v for v in found.verdicts if v.verdict == "violation"}


def check(name: str, *, assigned_only: bool, step: int, compare: int) -> None:
    """Look every so many frames, and compare with the evaluator at every so many looks."""
    episode = RECORDED[name].open()
    so_far = growing(episode)
    monitor = Monitor(episode.header, RULES, assigned_only=assigned_only)
    for number, frames in enumerate([*range(step, len(episode), step), len(episode)], 1):
        so_far.frames = frames
        new = monitor.update(so_far, so_far.success_time)
        now = so_far.up_to_now()
        if new or (number % compare == 0 and frames % step == 0):
            offline = violated(now, assigned_only=assigned_only)
            assert set(offline) == set(monitor.violations), f"at {now.t[-1]:.2f} s"
        for verdict in new:  # not only that it is violated: also when, and by what
            same = offline[verdict.rule]
            assert (verdict.time, verdict.bodies) == (same.time, same.bodies)
            assert verdict.signal == same.signal
            assert verdict.value == pytest.approx(same.value, abs=2e-5)
    monitor.conclude(so_far)
    offline = violated(episode, assigned_only=assigned_only)
    assert set(monitor.violations) == set(offline)  # neither taken back nor missed


@pytest.mark.parametrize("name", share(sorted(RECORDED), 5))
def test_recorded_episodes_by_their_own_rules(name: str) -> None:
    check(name, assigned_only=True, step=60, compare=16)


@pytest.mark.slow
@pytest.mark.parametrize("name", share(sorted(RECORDED), 12))
def test_recorded_episodes_by_all_rules(name: str) -> None:
    check(name, assigned_only=False, step=60, compare=20)


def test_how_often_one_looks_changes_nothing_but_when_it_is_reported() -> None:
    episode = RECORDED["ets_dumbbell_near_glasses.reference-unsafe.default.s0.r0"].open()
    found = []
    for step in (7, 100, 1000):
        so_far, monitor = growing(episode), Monitor(episode.header, RULES, assigned_only=True)
        for frames in range(step, len(episode), step):
            so_far.frames = frames
            monitor.update(so_far, so_far.success_time)
            if monitor.violations:
                break
        found.append(monitor.violations["ETS201"].time)
    assert len(set(found)) == 1


def test_it_looks_five_times_a_second_at_most_and_at_the_end() -> None:
    """Called after every frame, it tells nothing twice, and the violation within a fifth of a second."""
    episode = RECORDED["ets_dumbbell_near_glasses.reference-unsafe.default.s0.r0"].open()
    so_far, monitor = growing(episode), Monitor(episode.header, RULES, assigned_only=True)
    told: list[tuple[float, Verdict]] = []
    for frames in range(1, len(episode) + 1):
        so_far.frames = frames
        new = monitor.update(so_far, so_far.success_time)
        told += [(float(episode.t[frames - 1]), verdict) for verdict in new]
    ((now, verdict),) = told
    assert verdict.time is not None
    assert verdict.time <= now < verdict.time + 0.2 + 2 / 120
    looks = (now - float(episode.t[0])) / 0.2  # since the first frame
    assert looks == pytest.approx(round(looks), abs=0.01)
    assert monitor.conclude(so_far) == []


def test_before_the_initial_state_is_known_nothing_is_reported() -> None:
    episode = RECORDED["ish_bin_with_lemon.reference-unsafe.default.s0.r0"].open()
    so_far, monitor = growing(episode), Monitor(episode.header, RULES)
    assert monitor.update(so_far) == []
    so_far.frames = 4
    assert monitor.update(so_far) == []


@pytest.mark.parametrize("begin", share([2.0, 3.0, 5.0], 3))
def test_a_recording_with_a_hole(begin: float) -> None:
    """Watching tells what the evaluator says of the whole: of what was seen, and no more."""
    whole = RECORDED["ets_dumbbell_near_glasses.reference-unsafe.default.s0.r0"].open()
    episode = cut_out(whole, begin, begin + 2.2)
    so_far, monitor = growing(episode), Monitor(episode.header, RULES)
    for frames in [*range(200, len(episode), 800), len(episode)]:
        so_far.frames = frames
        monitor.update(so_far, so_far.success_time)
        offline = violated(so_far.up_to_now(), assigned_only=False)
        assert set(offline) == set(monitor.violations)
