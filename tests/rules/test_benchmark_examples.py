"""Every rule and cost that asks another benchmark's question calls its examples right."""

from functools import cache, lru_cache

import pytest
from sampled import share

from safestage_eval.episode import Episode
from safestage_eval.episode.invariants import check
from safestage_eval.rules import RuleSet, benchmark_names, load_rules
from safestage_eval.rules.files import BENCHMARKS, builtin_folder
from safestage_eval.verdicts.verdict import Verdict
from safestage_eval.whatif.examples import Library, deciding, examples_of
from safestage_eval.whatif.mistakes import KINDS
from safestage_eval.whatif.mutants import definitions, hunt

FOLDER = builtin_folder() / BENCHMARKS / "examples"

EACH = [(name, code) for name in benchmark_names() for code in deciding(load_rules([name]))]


@lru_cache
def rules(name: str) -> RuleSet:
    return load_rules([name])


LIBRARY = Library()
"""Each scene is drawn and measured once, for all tests here."""


@cache
def drawn(example: str) -> Episode:
    (name, code), *_ = EACH
    return LIBRARY.episode(example, rules(name).scoped[code])


def judged(name: str, code: str, example: str) -> Verdict:
    return LIBRARY.judge(example, rules(name), rules(name).scoped[code])


@pytest.mark.parametrize(("name", "code"), EACH, ids=lambda v: v)
def test_its_examples(name: str, code: str) -> None:
    rule = rules(name).scoped[code]
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
    for example in rule.undecided:
        assert judged(name, code, example).verdict == "inconclusive", example


MEASURED = {
    ("robolab", code) for code in ("RLB201", "RLB202", "RLB203", "RLB204", "RLB205", "RLB301")
}
"""Costs that are reported there too, and that nothing is judged by: they have no budget."""


def test_every_cost_decides_something() -> None:
    undecided = {
        (name, code)
        for name in benchmark_names()
        for code in rules(name).scoped.keys() - deciding(rules(name)).keys()
    }
    assert undecided == MEASURED


def test_every_scene_is_sound_and_used() -> None:
    named = set()
    for name, code in EACH:
        named |= {example for example, _ in examples_of(rules(name).scoped[code])}
    assert {scene.partition("(")[0] for scene in named} == {p.stem for p in FOLDER.glob("*.toml")}
    for file in sorted(FOLDER.glob("*.toml")):
        assert check(drawn(file.stem)) == [], file.stem


@pytest.mark.slow
@pytest.mark.parametrize(("name", "code"), share(EACH, 4), ids=lambda v: v)
def test_the_examples_notice_every_mistake(name: str, code: str) -> None:
    """A limit turned round, a duration halved, a role exchanged, a scope widened, …"""
    kinds = share(KINDS, 3, of=code)
    found = hunt([rules(name)], code, LIBRARY, kinds=kinds)
    survived = {mutant.what for mutant in found if mutant.killer is None}
    assert survived <= {*WITHOUT_EFFECT.get((name, code), [])}


WITHOUT_EFFECT = {
    # what has gone 15 cm sideways has gone more than the 10 cm that are a fall in any direction
    ("libero_safety", "fallen"): ["way_xy(a) more than 15 cm (fall_way_xy) → more than 150.0 cm"],
    # a distance is as long from one end as from the other: it squares the differences of coordinates,
    # whose sign is then lost
    ("safety_gymnasium", "SGY101"): ["stands_over(agent, hazard) → stands_over(hazard, agent)"],
    ("safety_gymnasium", "SGY110"): ["dist_xy(agent, hazard) → dist_xy(hazard, agent)"],
    ("safety_gymnasium", "stands_over"): ["dist_xy(a, b) → dist_xy(b, a)"],
    ("safety_gymnasium", "dist_xy"): [
        "east_off(a, b) → east_off(b, a)",
        "north_off(a, b) → north_off(b, a)",
    ],
    ("safety_gymnasium", "east_off"): [
        "difference of east(a) and east(b) → difference of east(b) and east(a)"
    ],
    ("safety_gymnasium", "north_off"): [
        "difference of north(a) and north(b) → difference of north(b) and north(a)"
    ],
}
"""Mistakes in a rule, or in what it rests on, that change no verdict, whatever the episode."""

SHARED = definitions(load_rules(["ish", "ets", "fsh"]))
"""Definitions behind those rules are held to their meaning by examples too."""

OWN = [(n, d) for n in benchmark_names() for d in definitions(rules(n)) if d not in SHARED]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "defined"), share(OWN, 4))
def test_some_example_notices_every_mistake_in_what_rules_rest_on(name: str, defined: str) -> None:
    found = hunt([rules(name)], defined, LIBRARY, kinds=share(KINDS, 3, of=defined))
    survived = {mutant.what for mutant in found if mutant.killer is None}
    assert survived <= {*WITHOUT_EFFECT.get((name, defined), [])}
