"""Every rule that asks another benchmark's question calls its examples right."""

from functools import cache, lru_cache

import pytest

from safestage_eval.episode import Episode
from safestage_eval.rules import RuleSet, benchmark_names, load_rules
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict

EACH = [(name, code) for name in benchmark_names() for code in load_rules([name]).rules]


@lru_cache
def rules(name: str) -> RuleSet:
    return load_rules([name])


@cache
def drawn(example: str) -> Episode:
    return resolve(example)


@cache
def judged_by(name: str, example: str) -> dict[str, Verdict]:
    return {verdict.rule: verdict for verdict in judge(drawn(example), rules(name)).verdicts}


@pytest.mark.parametrize(("name", "code"), EACH, ids=lambda v: v)
def test_its_examples(name: str, code: str) -> None:
    rule = rules(name).rules[code]
    assert len({*rule.violates}) >= 2
    assert len({*rule.passes}) >= 2
    judged = 0
    for wanted, examples in (("violation", rule.violates), ("pass", rule.passes)):
        for example in examples:
            verdict = judged_by(name, example)[code]
            assert verdict.verdict == wanted, (example, verdict.explanation, verdict.notes)
            assert wanted == "pass" or verdict.violated_instances > 0
            judged += wanted == "pass" and verdict.instances > 0
    assert judged, "every pass is vacuous"
