"""Built-in policies: the controls, noise, replays, and how they are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safestage_eval.errors import InputError
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from simulate.policies.policy_names import policy_named
from simulate.record.jobs import Job
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

TASK = task_named("fsh_orange_on_plate")
SHORT = Setting(TASK, horizon=3.0)


def rolled(name: str, setting: Setting = SHORT):
    return roll_out(setting, policy_named(name, setting.draw))


@pytest.mark.parametrize("name", ["random-near-home", "noisy:0.01"])
def test_what_is_random_is_drawn_from_the_setting(name: str) -> None:
    action = rolled(name).episode().frames.action
    assert np.array_equal(rolled(name).episode().frames.action, action)
    other = Setting(TASK, rollout=1, horizon=3.0)
    assert not np.array_equal(rolled(name, other).episode().frames.action, action)


def test_wandering_stays_near_home_and_touches_nothing() -> None:
    episode = rolled("random-near-home", Setting(TASK, horizon=10.0)).episode()
    off = episode.frames.action[:, :7] - episode.frames.joint_position[0, :7]
    assert 0.03 < off[len(off) // 4 :].std() < 0.15
    assert episode.frames.action[:, 7].max() == 0
    found = judge(episode, load_rules(["ish", "ets", "fsh"]))
    assert [v.rule for v in found.verdicts if v.verdict == "violation"] == []
    assert found.success is False


def test_noise_is_as_large_as_it_says_and_spares_the_gripper() -> None:
    noisy, clean = (rolled(n).episode().frames.action for n in ("noisy:0.01", "noisy:0"))
    off = (noisy - clean)[:8]  # the first action: no feedback yet
    assert np.array_equal(clean[:8], rolled("reference:safe").episode().frames.action[:8])
    assert 0.001 < np.abs(off[:, :7]).max() < 0.05
    assert off[:, 7].max() == 0


def test_a_replay_repeats_the_rollout(tmp_path: Path) -> None:
    longer = Setting(TASK, horizon=5.0)
    recorded = rolled("reference:unsafe", longer)
    path = tmp_path / "orange.mcap"
    recorded.close(path)
    again = rolled(f"replay:{path}", longer).episode()
    first = recorded.episode()
    was, now = (e.tracks["orange"].position for e in (first, again))
    assert now == pytest.approx(was, abs=1e-3)
    assert np.ptp(was[:, 2]) > 0.01, "it was lifted"
    assert np.array_equal(again.frames.action, first.frames.action)


def test_names_make_ids_that_files_can_have(tmp_path: Path) -> None:
    path = tmp_path / "orange.mcap"
    rolled("idle", Setting(TASK, horizon=0.5)).close(path)
    for name in (f"replay:{path}", "noisy:0.01:unsafe", "random-near-home"):
        identity = Job(SHORT, name).episode_id
        assert "/" not in identity
        assert ":" not in identity
        assert policy_named(name).name == name


@pytest.mark.parametrize(
    "name", ["random", "noisy", "noisy:much", "noisy:-1", "noisy:0.1:odd", "reference:best", ""]
)
def test_what_is_no_policy_is_told_what_there_is(name: str) -> None:
    with pytest.raises(InputError, match="noisy:SIGMA"):
        policy_named(name)


def test_a_replay_needs_an_episode_with_commands(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="replay:"):
        policy_named(f"replay:{tmp_path / 'none.mcap'}")
