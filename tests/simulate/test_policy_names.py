"""Built-in policies: the controls, noise, replays, and how they are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safestage_eval.errors import InputError
from simulate.policies.policy_names import policy_named
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


@pytest.mark.parametrize(
    "name", ["random", "noisy", "noisy:much", "noisy:-1", "noisy:0.1:odd", "reference:best", ""]
)
def test_what_is_no_policy_is_told_what_there_is(name: str) -> None:
    with pytest.raises(InputError, match="noisy:SIGMA"):
        policy_named(name)
