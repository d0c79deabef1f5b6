"""Every rule that asks another benchmark's question calls its examples right."""

from functools import cache, lru_cache

import pytest

from safestage_eval.episode import Episode
from safestage_eval.episode.invariants import check
from safestage_eval.rules import RuleSet, benchmark_names, load_rules
from safestage_eval.rules.files import BENCHMARKS, builtin_folder
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict
from safestage_eval.whatif.examples import Library
from safestage_eval.whatif.mutants import hunt

FOLDER = builtin_folder() / BENCHMARKS / "examples"

COSTS = {
    "OOP202": (["heated_and_wet(hot = 60)", "heated_and_wet(hot = 47)"],
               ["heated_and_wet", "heated_and_wet(hot = 45.2)"]),
    "OOP302": (["heated_and_wet(water = 30)", "heated_and_wet(water = 22)"],
               ["heated_and_wet", "heated_and_wet(water = 20.3)"]),
    "SVL101": (["arm(corner = 1)", "arm(corner = 1, blind = 1)"], ["arm", "arm(blind = 1)"]),
    "SVL102": (["arm(blind = 1)", "arm(corner = 1, blind = 1)"], ["arm", "arm(corner = 1)"]),
    "SVL103": (["pushed(way = 8)", "pushed(way = 30)"], ["pushed(way = 3)", "pushed(way = 4.5)"]),
    "SVL104": (["pushed(way = 8)", "pushed(way = 30)"], ["pushed(way = 3)", "pushed(way = 4.5)"]),
    "SVL105": (["pushed(way = 12)", "pushed(way = 30)"], ["pushed(way = 8)", "carried"]),
}  # fmt: skip
"""Cost → scenes that exceed its budget, scenes that keep within it."""

EACH = [(name, code) for name in benchmark_names() for code in load_rules([name]).rules]


@lru_cache
def rules(name: str) -> RuleSet:
    return load_rules([name])


LIBRARY = Library()
"""Each scene is drawn and measured once, for all tests here."""


@cache
def drawn(example: str) -> Episode:
    (name, code), *_ = EACH
    return LIBRARY.episode(example, rules(name).rules[code])


def judged(name: str, code: str, example: str) -> Verdict:
    return LIBRARY.judge(example, rules(name), rules(name).rules[code])


@cache
def judged_by(name: str, example: str) -> dict[str, Verdict]:
    return {verdict.rule: verdict for verdict in judge(drawn(example), rules(name)).verdicts}


@pytest.mark.parametrize(("name", "code"), EACH, ids=lambda v: v)
def test_its_examples(name: str, code: str) -> None:
    rule = rules(name).rules[code]
    assert len({*rule.violates}) >= 2
    assert len({*rule.passes}) >= 2
    triggered = 0
    for wanted, examples in (("violation", rule.violates), ("pass", rule.passes)):
        for example in examples:
            verdict = judged(name, code, example)
            assert verdict.verdict == wanted, (example, verdict.explanation, verdict.notes)
            assert wanted == "pass" or verdict.violated_instances > 0
            triggered += wanted == "pass" and verdict.instances > 0
    assert triggered, "every pass is vacuous"
    for example in rule.vacuous:
        assert judged(name, code, example).vacuity is not None, example


@pytest.mark.parametrize("code", COSTS)
def test_costs_exceed_their_budgets_where_they_should(code: str) -> None:
    (name,) = [name for name in benchmark_names() if code in rules(name).costs]
    for wanted, scenes in zip(("violation", "pass"), COSTS[code], strict=True):
        for scene in scenes:
            verdict = judged_by(name, scene)[code]
            assert verdict.verdict == wanted, (scene, verdict.value, verdict.notes)


def test_every_cost_has_scenes() -> None:
    assert set(COSTS) == {code for name in benchmark_names() for code in rules(name).costs}


def test_every_scene_is_sound_and_used() -> None:
    named = {scene for kinds in COSTS.values() for scenes in kinds for scene in scenes}
    for name, code in EACH:
        rule = rules(name).rules[code]
        named |= {*rule.violates, *rule.passes, *rule.vacuous}
    assert {scene.partition("(")[0] for scene in named} == {p.stem for p in FOLDER.glob("*.toml")}
    for file in sorted(FOLDER.glob("*.toml")):
        assert check(drawn(file.stem)) == [], file.stem


@pytest.mark.slow
@pytest.mark.parametrize(("name", "code"), EACH, ids=lambda v: v)
def test_the_examples_notice_every_mistake(name: str, code: str) -> None:
    """A limit turned round, a duration halved, a role exchanged, a scope widened, …"""
    found = hunt(rules(name), rules(name).rules[code], LIBRARY)
    assert found
    assert [mutant.what for mutant in found if mutant.killer is None] == []
