"""A golden file says what changed since it was written, and why."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest
from fabricated import NOT_APPLICABLE, PASS, VIOLATION, episode, scores

from safestage_eval.errors import InputError
from safestage_eval.report import render
from safestage_eval.report.golden import changes, write_golden
from safestage_eval.run.scores import Scores

SOUND = replace(scores(), problems=())


def compared(tmp_path, before, after):
    path = tmp_path / "golden.json"
    write_golden(Scores((before,)), path)
    return [str(change) for change in changes(Scores((after,)), path)]


def test_the_same_is_no_difference(tmp_path):
    write_golden(SOUND, tmp_path / "golden.json")
    assert changes(SOUND, tmp_path / "golden.json") == []
    assert [p.name for p in tmp_path.iterdir()] == ["golden.json"]


def test_order_does_not_matter(tmp_path):
    write_golden(SOUND, tmp_path / "a.json")
    turned = replace(SOUND, results=SOUND.results[::-1])
    write_golden(turned, tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_rounding_of_another_machine_is_no_difference(tmp_path):
    near = replace(VIOLATION, time=VIOLATION.time + 1 / 120, value=VIOLATION.value * (1 + 1e-5))
    assert compared(tmp_path, episode("one", VIOLATION), episode("one", near)) == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"verdict": "inconclusive"}, "verdict violation → inconclusive"),
        ({"time": 2.6}, "time 2.500 s → 2.600 s"),
        ({"time": None}, "time 2.500 s → none"),
        ({"signal": "tilt(mug é)"}, "signal edge_margin(mug é) → tilt(mug é)"),
        ({"value": 0.01}, "value 0.4 cm → 1.0 cm"),
        ({"limit": 0.03}, "limit 2.0 cm → 3.0 cm"),
    ],
)
@pytest.mark.parametrize(
    ("rule", "trace", "reason"),
    [
        ({}, {}, "the evaluator has changed"),
        ({"rule_digest": "e" * 64}, {}, "rule or parameter changed"),
        ({}, {"trace_hash": "b" * 64}, "the trace is another"),
        (
            {"rule_digest": "e" * 64},
            {"trace_hash": "b" * 64},
            "(the trace is another and rule or parameter changed: digest",
        ),
    ],
)
def test_each_change_with_its_reason(tmp_path, change, word, rule, trace, reason):
    after = episode("one", replace(VIOLATION, **change, **rule), **trace)
    lines = compared(tmp_path, episode("one", VIOLATION), after)
    (line,) = [line for line in lines if "FSH101" in line]
    assert line.startswith("one: ")
    assert word in line
    assert reason in line
    assert len(lines) == 1 + bool(trace)


def test_several_changes_of_a_rule_are_one_line(tmp_path):
    (line,) = compared(tmp_path, episode("one", VIOLATION), episode("one", PASS))
    assert "verdict violation → pass" in line
    assert "time 2.500 s → none" in line


def test_a_new_trace_with_the_same_verdicts_is_said(tmp_path):
    (line,) = compared(tmp_path, episode("one"), episode("one", trace_hash="b" * 64))
    assert "the trace is not the one" in line


def test_success(tmp_path):
    (line,) = compared(tmp_path, episode("one"), episode("one", success=False))
    assert "success True → False" in line
    (line,) = compared(tmp_path, episode("one"), episode("one", success_time=2.1))
    assert "success_time 2.000 s → 2.100 s" in line


def test_episodes_and_rules_that_come_and_go(tmp_path):
    lines = compared(tmp_path, episode("one"), episode("two"))
    assert sorted(line.split(":")[0] for line in lines) == ["one", "two"]
    other = replace(VIOLATION, rule="FSH104")
    lines = compared(tmp_path, episode("one", VIOLATION), episode("one", other))
    assert sorted(lines) == [
        "one: FSH101: is not assigned or named any more",
        "one: FSH104: was not assigned or named",
    ]


def test_rules_that_are_not_loaded(tmp_path):
    (line,) = compared(
        tmp_path, episode("one", VIOLATION), episode("one", NOT_APPLICABLE, not_loaded=("FSH101",))
    )
    assert "not among the loaded rules" in line


def test_nothing_is_expected_of_what_could_not_be_judged(tmp_path):
    with pytest.raises(InputError, match="1 episode could not be judged"):
        write_golden(scores(), tmp_path / "golden.json")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "text",
    [
        b"", b"{", b"[]", b"3", b"{}", b'{"episodes": 3}', b'{"episodes": ["one"]}',
        b'{"episodes": {"one": {}}}', b'{"episodes": {"one": null}}', b"\xff\xfe\x00",
        b'{"episodes": {"one": {"trace_hash": 1, "success": 2, "rules": []}}}',
        b'{"episodes": {"one": {"trace_hash": 1, "success": 2, "rules": {"FSH101": {}}}}}',
    ],
)  # fmt: skip
def test_not_a_golden_file(tmp_path, text):
    path = tmp_path / "golden.json"
    path.write_bytes(text)
    with pytest.raises(InputError, match="not a golden file"):
        changes(scores(), path)


def test_value_limit_and_digest_are_reported_with_a_verdict_that_flips(tmp_path):
    after = replace(VIOLATION, verdict="pass", limit=0.003, rule_digest="e" * 64)
    (line,) = compared(tmp_path, episode("one", VIOLATION), episode("one", after))
    assert "verdict violation → pass" in line
    assert "value still 0.4 cm, limit 2.0 cm → 0.3 cm" in line
    assert "rule or parameter changed: digest dddddddd → eeeeeeee" in line


def test_each_side_of_another_signal_has_its_own_unit(tmp_path):
    """A length decided before; a force, or the start of a state, decides now."""
    force = replace(VIOLATION, signal="contact_force(robot, mug)", value=0.5, limit=0.1,
                    dimension="force")  # fmt: skip
    (line,) = compared(tmp_path, episode("one", VIOLATION), episode("one", force))
    assert "value 0.4 cm → 0.50 N, limit 2.0 cm → 0.10 N" in line
    moment = replace(VIOLATION, signal="committed(mug)", value=3.2, limit=2.0, dimension="time")
    (line,) = compared(tmp_path, episode("one", moment), episode("one", VIOLATION))
    assert "value 3.2 (SI) → 0.4 cm, limit 2 (SI) → 2.0 cm" in line


def test_messages_name_the_option_that_writes_anew(tmp_path):
    with pytest.raises(InputError, match="pytest --mine"):
        changes(scores(), tmp_path / "none.json", "pytest --mine")


def cases(scores, found):
    root = ET.fromstring(render(scores, "junit", found))
    return {
        (case.get("classname"), case.get("name")): [
            (child.tag, child.get("message")) for child in case
        ]
        for suite in root
        for case in suite
    }


def test_for_build_servers_only_what_differs_fails(tmp_path):
    path = tmp_path / "golden.json"
    write_golden(SOUND, path)
    as_expected = cases(SOUND, changes(SOUND, path))
    assert ("failure", VIOLATION.explanation) in cases(SOUND, None)["mug_on_shelf.FSH101", "one"]
    assert not any(tag == "failure" for case in as_expected.values() for tag, _ in case)
    assert render(SOUND, "github", []) == ""

    other = [replace(r, success=False) if r.episode_id == "two" else r for r in SOUND.results[1:]]
    other[0] = episode("two", VIOLATION, seed=4, success=False)
    now = replace(SOUND, results=tuple(other))
    found = changes(now, path)
    result = cases(now, found)
    failed = {key: case for key, case in result.items() if case and case[0][0] == "failure"}
    assert {key[1] for key in failed} == {"one", "two"}
    assert "expected, but not among the episodes" in failed["golden", "one"][0][1]
    assert "pass → violation" in failed["mug_on_shelf.FSH101", "two"][0][1]
    annotations = render(now, "github", found).splitlines()
    assert len(annotations) == len(found)
    assert all(line.startswith("::error title=") for line in annotations)
