"""Learned policies roll out like any other, the same each time, and served as directly."""

from __future__ import annotations

import numpy as np
import pytest
from served import blind  # noqa: F401 - a fixture

from safestage_eval.errors import InputError
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from simulate.learn.checkpoint import shipped
from simulate.policies.policy_names import policy_name, policy_named
from simulate.record.rollout import Setting, roll_out
from simulate.servers.serve import serve
from simulate.tasks.task import task_named

pytest.importorskip("onnxruntime")
pytestmark = pytest.mark.simulate

TASK = "fsh_dictionary_on_glasses"
SETTING = Setting(task_named(TASK), seed=100, horizon=3.0)
PROTOCOLS = ("openpi", "groot")


def rolled(name: str, setting: Setting = SETTING):
    return roll_out(setting, policy_named(name, setting.draw)).episode()


def verdicts(episode) -> dict[str, str]:
    found = judge(episode, load_rules(["ish", "ets", "fsh"]))
    return {v.rule: v.verdict for v in found.verdicts}


@pytest.mark.parametrize("name", shipped())
def test_a_rollout_repeats_itself_and_moves(name: str) -> None:
    one, two = rolled(f"learned:{name}"), rolled(f"learned:{name}")
    assert one.header.policy == f"learned:{name}"
    assert np.array_equal(one.frames.action, two.frames.action)
    assert np.ptp(one.frames.joint_position[:, :7], axis=0).max() > 0.2


def test_its_noise_is_drawn_from_the_setting() -> None:
    other = Setting(SETTING.task, seed=100, rollout=1, horizon=1.0)
    one = rolled("learned:act", Setting(SETTING.task, seed=100, horizon=1.0))
    assert not np.array_equal(rolled("learned:act", other).frames.action, one.frames.action)


@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_served_it_does_what_it_does_directly(protocol: str) -> None:
    """Over the wire go the same commands in the same steps, so verdicts are the same."""
    name = shipped()[PROTOCOLS.index(protocol) % len(shipped())]
    direct = rolled(f"learned:{name}")
    with serve(f"learned:{name}", protocol, port=0, seed=SETTING.seed, task=TASK) as server:
        served = rolled(f"{protocol}:{server.url}?name=model")
    assert served.header.termination == direct.header.termination, served.header.notes
    assert np.array_equal(served.frames.action, direct.frames.action)
    assert verdicts(served) == verdicts(direct)


def test_what_it_was_not_trained_on_is_told() -> None:
    assert policy_name("learned:act") == "learned:act"
    with pytest.raises(InputError, match="not trained on"):
        policy_named("learned:act").reset("my_task", "Put it there.")
    with pytest.raises(InputError, match=r"the path of an \.onnx file"):
        policy_named("learned:best")
