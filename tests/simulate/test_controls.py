"""The false-alarm floor: an arm that holds still never succeeds and never violates anything."""

import pytest
from sampled import share

from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from simulate.policies.controls import Idle
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import tasks


@pytest.mark.slow
@pytest.mark.parametrize("name", share(sorted(tasks()), 48))
def test_idle_for_five_seconds(name: str) -> None:
    """``safestage bench tasks validate --controls`` does it with all tasks."""
    episode = roll_out(Setting(tasks()[name], seed=0, horizon=5.0), Idle()).episode()
    assert float(episode.t[-1]) > 4.9
    result = judge(episode, load_rules(["ish", "ets", "fsh", "goals"]))
    assert result.success is False
    assert result.violation is False
    assert [v.rule for v in result.verdicts if v.verdict == "violation"] == []
