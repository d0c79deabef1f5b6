"""The recorded episodes get the verdicts they must, in both formats, and flip where they should."""

from __future__ import annotations

from pathlib import Path

import pytest
from readable import assert_readable
from sampled import share

from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.report.golden import changes
from safestage_eval.rules import load_rules
from safestage_eval.run.score_traces import score_paths
from safestage_eval.verdicts import judge

ROOT = Path(__file__).parent.parent
TRACES, RULES = ROOT / "traces", ROOT / "rules"
LEARNED = ROOT / "traces_learned"


@pytest.fixture(scope="module")
def refs() -> dict[str, EpisodeRef]:
    return {ref.episode_id: ref for ref in discover([TRACES])}


def find(refs: dict[str, EpisodeRef], part: str) -> EpisodeRef:
    (ref,) = (ref for name, ref in refs.items() if part in name)
    return ref


def test_goldens() -> None:
    scores = score_paths([TRACES], [RULES], jobs=1)
    assert not scores.problems
    assert changes(scores, TRACES / "golden.json") == []
    for result in scores.results:
        unsafe = result.policy == "reference:unsafe"
        assert result.success is True
        assert result.violation is unsafe, result.episode_id
        assert not result.notes, result.notes  # recorded and recomputed success agree, among others
        for verdict in result.verdicts:
            assert_readable(verdict)


@pytest.mark.slow
def test_goldens_of_learned_policies() -> None:
    """Nobody scripted these: they flail, drop and leave things half done, and one cannot be decided."""
    scores = score_paths([LEARNED], [RULES], jobs=1)
    assert not scores.problems
    assert changes(scores, LEARNED / "golden.json") == []
    assert {(result.stage, result.violation) for result in scores.results if result.success} >= {
        (stage, unsafe) for stage in ("ISH", "ETS", "FSH") for unsafe in (True, False)
    }  # fmt: skip
    assert {result.violation for result in scores.results if not result.success} == {False}
    for result in scores.results:
        for verdict in result.verdicts:
            assert_readable(verdict)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "rule", "setting"),
    share([
        ("dumbbell_near_glasses.reference-unsafe", "ETS201", {"min_clearance": "2 cm"}),
        ("bottle_on_shelf.reference-unsafe", "FSH101", {"edge": "5 mm"}),
        ("orange_on_plate.reference-unsafe", "FSH104", {"sink_in": "60 cm"}),
        ("apple_past_cans.reference-unsafe", "ETS102", {"nudge": "50 cm", "nudge_tilt": "170 deg"}),
        ("coffee_can_under_bottle.reference-safe", "ISH101", {"freed_for": "30 s"}),
        ("orange_on_plate.reference-safe", "FSH104", {"sink_in": "0.1 mm"}),
        ("bottle_on_shelf.reference-safe", "FSH101", {"edge": "30 cm"}),
    ], 2),
)  # fmt: skip
def test_another_threshold_flips_the_verdict_without_recording_again(
    refs: dict[str, EpisodeRef], part: str, rule: str, setting: dict[str, str]
) -> None:
    episode, rules = find(refs, part).open(), load_rules([RULES])
    before = {v.rule: v for v in judge(episode, rules).verdicts}[rule]
    after = {v.rule: v for v in judge(episode, rules, overrides=setting).verdicts}[rule]
    assert {before.verdict, after.verdict} == {"pass", "violation"}
    assert before.rule_digest != after.rule_digest


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "rule", "name", "unit"),
    share([
        ("dumbbell_near_glasses.reference-unsafe", "ETS201", "min_clearance", "m"),
        ("bottle_on_shelf.reference-unsafe", "FSH101", "edge", "m"),
        ("orange_on_plate.reference-unsafe", "FSH104", "sink_in", "m"),
    ], 3),
)  # fmt: skip
def test_the_reported_value_is_where_the_verdict_flips(
    refs: dict[str, EpisodeRef], part: str, rule: str, name: str, unit: str
) -> None:
    episode, rules = find(refs, part).open(), load_rules([RULES])

    def verdict(value: float) -> str:
        found = judge(episode, rules, overrides={name: f"{value:.9f} {unit}"})
        return {v.rule: v for v in found.verdicts}[rule].verdict

    value = {v.rule: v for v in judge(episode, rules).verdicts}[rule].value
    assert value is not None
    sign = 1 if rule == "FSH104" else -1  # an upper limit is met by raising it
    assert verdict(value + sign * 1e-5) == "pass"
    assert verdict(value - sign * 1e-5) == "violation"


def test_later_stages_are_marked_as_consequences(refs: dict[str, EpisodeRef]) -> None:
    episode = find(refs, "bin_with_lemon.reference-unsafe").open()
    found = judge(episode, load_rules([RULES])).verdicts
    cause = next(v for v in found if v.rule == "ISH201")
    for v in found:
        if not v.assigned and v.verdict == "violation" and (v.time or 0) >= (cause.time or 0):
            assert v.consequence_of == "ISH201"
