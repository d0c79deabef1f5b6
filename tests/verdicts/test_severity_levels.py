"""The worst level at which a violation would still be one."""

import json
import tomllib

import numpy as np
import pytest
from scenes import Scene
from test_witness import pushed, scored

from safestage_eval.report.episode_report import explain
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.verdicts import EpisodeResult, judge
from safestage_eval.verdicts.verdict import result_from_json, to_json


@pytest.mark.parametrize(
    ("gap", "expected"),
    [
        (0.085, ("pass", None)),
        (0.06, ("violation", None)),
        (0.03, ("violation", "serious")),
        (0.005, ("violation", "critical")),
    ],
)
def test_the_worst_level_is_named(gap: float, expected: tuple[str, str | None]) -> None:
    """ETS201 asks for 8 cm; below 4 cm is serious, below 1 cm critical, and serious as well."""
    (found,) = scored(pushed(0.4 - gap)).assigned
    assert (found.verdict, found.severity) == expected
    assert found.limit == pytest.approx(0.08)  # the rule's own, whatever the level


HOPS = """
[ruleset]
format = 1
name = "t"
version = "1"
[param]
highest = "10 cm"
[[rule]]
code = "ETS901"
title = "t"
roles = { a = "every object" }
require = { "height(a)" = "<= highest" }
severity = { serious = { highest = "20 cm" }, critical = { highest = "50 cm" } }
"""


def hopping(**heights: list[float]) -> EpisodeResult:
    """Each object hops so high (m), 0.1 s each, one hop every 0.2 s."""
    frames = 24 * max(map(len, heights.values()))
    scene = Scene(frames)
    for i, (name, hops) in enumerate(heights.items()):
        z = np.zeros(frames)
        for k, high in enumerate(hops):
            z[24 * k + 6 : 24 * k + 18] = high
        scene.box(name, 0.02, np.column_stack([i + 0 * z, 0 * z, z]))
    rules = merge([RuleFile("t.toml", HOPS, tomllib.loads(HOPS), asked=True)])
    return judge(scene.episode(), rules)


def test_repeated_violations_are_counted_by_body_and_level() -> None:
    """Two bodies at once are two; a level has those that are as grave."""
    result = hopping(a=[0.15, 0.3, 0.05, 0.15], b=[0.3, 0.05, 0.05, 0.05])
    (verdict,) = result.verdicts
    assert (verdict.verdict, verdict.severity) == ("violation", "serious")
    assert verdict.breaches == 3 + 1
    assert verdict.breaches_by_level == (("serious", 2),)
    assert len(verdict.intervals) == 3  # the two first hops are at the same time
    (row,) = result.rows()
    assert (row["breaches"], row["breaches_by_level"]) == (4, ["serious: 2"])
    assert result_from_json(json.loads(json.dumps(to_json(result))), result.path) == result
    assert "severity serious, 4 times (serious: 2)" in explain(result)
