"""``safestage rules test``: examples found, judged and compared; broken rules noticed or told."""

import json
from xml.etree import ElementTree as ET

import pytest
from studio import block, run

from safestage_eval.formats import discover, save
from safestage_eval.rules import load_rules
from safestage_eval.whatif.examples import Library
from safestage_eval.whatif.mutants import (
    check_sets,
    hunt,
)

RULE = """
[ruleset]
format  = 1
name    = "mine"
version = "1"
extends = ["fsh"]
[[rule]]
code    = "FSH901"
title   = "Leave it clear of the edge and level"
roles   = { target = "object" }
during  = "settle(target)"
[rule.require]
"edge_margin(target)" = ">= edge"
"supported(target)"   = true
[rule.examples]
violates = VIOLATES
passes   = PASSES
"""

SKETCH = """
duration = "1 s"
roles    = { target = "block" }
story    = []
knobs    = { x = "0" }
[bodies.block]
shape = "box 6 x 6 x 6 cm"
at    = "{x}, 0 cm"
mass  = "500 g"
"""


@pytest.fixture
def house(tmp_path):
    """Writes a rule file with these examples; beside it one trace; a folder of two more."""
    (tmp_path / "rules" / "examples").mkdir(parents=True)
    save(block("beside", room=0.01), tmp_path / "rules" / "examples" / "beside.mcap")
    save(block("near", room=0.012), tmp_path / "traces" / "n.mcap")
    save(block("far", room=0.03), tmp_path / "traces" / "f.mcap")
    save(block("middle"), tmp_path / "traces" / "m.mcap")

    def write(violates, passes):
        text = RULE.replace("VIOLATES", json.dumps(violates)).replace("PASSES", json.dumps(passes))
        (tmp_path / "rules" / "mine.toml").write_text(text)
        return tmp_path / "rules" / "mine.toml", tmp_path / "traces"

    return write


def listed(*arguments):
    done = run("rules", "test", *arguments, "-f", "json")
    return done, json.loads(done.text)


def killers(rules, traces):
    """Mistake → the example that notices it."""
    loaded = load_rules([rules])
    found = hunt([loaded], "FSH901", Library(discover([traces])))
    return {mutant.what: mutant.killer for mutant in found}


def test_all_as_expected(house):
    rules, traces = house(["beside", "near"], ["far", "middle"])
    done, document = listed(rules, "--traces", traces)
    assert done.code == 0
    assert [e["example"] for e in document["examples"]] == ["beside", "near", "far", "middle"]
    assert [e["margin"] for e in document["examples"][:3]] == pytest.approx([-1.0, -0.8, 1.0])
    text = run("rules", "test", rules, "--traces", traces).text
    assert "4 of 4 examples of 1 rule as expected" in text


@pytest.mark.parametrize(
    ("violates", "passes", "wrong"),
    [
        (["beside", "far"], ["far", "middle"], ["far"]),
        (["beside", "near"], ["near", "middle"], ["near"]),
        (["beside", "nowhere"], ["far", "middle"], ["nowhere"]),
    ],
)
def test_a_wrong_or_missing_example_fails(house, violates, passes, wrong):
    rules, traces = house(violates, passes)
    done, document = listed(rules, "--traces", traces)
    assert done.code == 1
    assert [e["example"] for e in document["examples"] if not e["right"]] == wrong
    lines = run("rules", "test", rules, "--traces", traces).text.splitlines()
    assert [line.split()[2] for line in lines if line.startswith("NO")] == wrong


def test_sketches_beside_the_file_and_their_knobs(house):
    rules, _ = house(["block(x = 76)"], ["block", "block(x = 70)"])
    (rules.parent / "examples" / "block.toml").write_text('says = "lies there"\n' + SKETCH)
    text = rules.read_text().replace('during  = "settle(target)"\n', "")
    rules.write_text(text)
    done, document = listed(rules, "--least", "1")
    assert [(e["example"], e["got"]) for e in document["examples"]] == [
        ("block(x = 76)", "violation"), ("block", "pass"), ("block(x = 70)", "pass"),
    ]  # fmt: skip
    assert done.code == 0


def test_junit_has_a_case_for_each(house):
    rules, traces = house(["beside", "far"], ["middle", "nowhere"])
    suite = ET.fromstring(run("rules", "test", rules, "-t", traces, "-f", "junit").text)[0]
    assert [case.get("name") for case in suite] == ["beside", "far", "middle", "nowhere"]
    assert [case.find("failure") is not None for case in suite] == [False, True, False, False]
    assert [case.find("error") is not None for case in suite] == [False, False, False, True]


def test_any_rule_may_notice_a_mistake_in_a_state_and_sets_share_it(tmp_path):
    files = []
    poor = 'violates = ["pushed(last = 2)"]\npasses = ["pushed(last = 1)"]\n'
    for name, examples in (("poor", poor), ("good", GOOD)):
        file = tmp_path / f"{name}.toml"
        file.write_text(COSTLY.replace("NAME", name) + "[cost.examples]\n" + examples)
        files.append(str(file))
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "pushed.toml").write_text(PUSHED)
    sets = {file: load_rules([file]) for file in files}
    suites, hunted = check_sets(sets, kinds=("unit",), deep=True, jobs=1)
    assert [suite.passed for suite in suites.values()] == [False, True]
    shared = [m for m in hunted[files[0]] if m.where == "quick"]
    assert {m.what: bool(m.killer) for m in shared} == {
        "speed(a) more than 2 cm/s → more than 0.2 cm/s": True,
        "speed(a) more than 2 cm/s → more than 20.0 cm/s": True,
    }
    assert not [m for m in hunted[files[1]] if m.where == "quick"]


COSTLY = """
[ruleset]
format  = 1
name    = "NAME"
version = "1"
[state.quick]
of   = ["a"]
when = { "speed(a)" = "> 2 cm/s" }
[[cost]]
code   = "FSH901"
title  = "Time on the move"
roles  = { thing = "every object" }
charge = [{ when = "quick(thing)", add = 1, per = "second" }]
budget = 1.5
"""

GOOD = """
violates = ["pushed(last = 2)", "pushed(last = 3)"]
passes   = ["pushed(last = 1)", "pushed(last = 2, way = 3)"]
"""

PUSHED = """
says     = "A box is pushed."
duration = "4 s"
knobs    = { last = "1", way = "8" }
story    = [{ move = "box", by = "{way}, 0, 0 cm", during = "0 to {last} s" }]
[bodies.box]
shape = "box 6 x 6 x 6 cm"
"""


@pytest.fixture
def costly(tmp_path):
    """A file with one cost, its budget and what it charges; beside it a sketch."""
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "pushed.toml").write_text(PUSHED)

    def write(budget="budget = 1.5", examples="[cost.examples]" + GOOD):
        text = COSTLY.replace("budget = 1.5", budget) + examples
        (tmp_path / "mine.toml").write_text(text)
        return tmp_path / "mine.toml"

    return write


def test_costs_have_examples_and_mistakes(costly):
    done, document = listed(costly(), "--mutate")
    assert [(e["example"], e["got"]) for e in document["examples"]] == [
        ("pushed(last = 2)", "violation"), ("pushed(last = 3)", "violation"),
        ("pushed(last = 1)", "pass"), ("pushed(last = 2, way = 3)", "pass"),
    ]  # fmt: skip
    mistakes = {
        m["what"].replace("1 per second while quick(thing) → ", ""): m["killer"]
        for m in document["mutants"]
    }
    assert {*mistakes} == {
        "10 per second while quick(thing)", "0.1 per second while quick(thing)",
        "1 per start of quick(thing)", "1 per step while quick(thing)",
        "when quick(thing) → the end of quick(thing)",
        "budget → at most 15", "budget → at most 0.15",
    }  # fmt: skip
    assert (done.code, None in mistakes.values()) == (0, False)


def test_good_examples_notice_what_poor_ones_let_through(house):
    rules, traces = house(["beside", "near"], ["far", "middle"])
    found = killers(rules, traces)
    assert found["edge_margin(target) at least 2 cm (edge) → at most 2 cm (edge)"] == "beside"
    assert found["edge_margin(target) at least 2 cm (edge) → at least 0.2 cm"] == "beside"
    assert found["edge_margin(target) at least 2 cm (edge) → at least 20.0 cm"] == "far"
    assert found["without: always supported(target)"] is None

    rules, traces = house(["beside"], ["middle"])
    save(block("middle", room=0.3), traces / "m.mcap")
    found = killers(rules, traces)
    assert found["edge_margin(target) at least 2 cm (edge) → at least 20.0 cm"] is None


def test_survivors_are_listed_and_fail(house):
    rules, traces = house(["beside", "near"], ["far", "middle"])
    done = run("rules", "test", rules, "-t", traces, "--mutate")
    assert done.code == 1
    assert "FSH901  obligation  without: always supported(target)" in done.text
    assert "5 of 7 mutants detected" in done.text


def test_worker_processes_say_the_same(house):
    rules, traces = house(["beside", "far"], ["middle", "nowhere"])
    arguments = ("rules", "test", rules, rules.parent / "mine.toml", "-t", traces, "--mutate")
    one, two = (run(*arguments, "--jobs", jobs) for jobs in ("1", "2"))
    assert (one.code, one.text, one.err) == (two.code, two.text, two.err)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--deep"], "--deep goes with --mutate"),
        (["nowhere.toml"], "no such rule file"),
        (["ets", "--traces", "nowhere"], "nowhere"),
    ],
)
def test_mistakes_of_use(arguments, said):
    done = run("rules", "test", *arguments)
    assert (done.code, done.out) == (2, b"")
    assert said in done.err
