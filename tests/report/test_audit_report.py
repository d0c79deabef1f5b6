"""Reports of an audit, in each of its formats."""

import json
from xml.etree import ElementTree as ET

import pytest

from safestage_eval.audit import Audit, Finding, Place, choose
from safestage_eval.report.audit_report import FORMATS, headline, render
from safestage_eval.verdicts.problem import Problem


def finding(number, code="AUD103", severity="error", what="frame_dt is 1 s."):
    place = Place(f"episode {number}", "a.mcap", ("cup",), "frame_dt", 1.5)
    return Finding(code, severity, place, what, "milliseconds", "set frame_dt = 0.01")


FOUND = Audit(
    (*map(finding, range(5)), finding(0, "AUD110", "warning", "50 % too rare: 1,2.")),
    12, (Problem("b.mcap", "b.mcap: it ends at byte 7."),), ("aborted",), ("AUD103", "AUD104", "AUD110"),
)  # fmt: skip


def test_the_gravest_come_first_and_few_are_written_out():
    text = render(FOUND, width=80)
    assert text.index("AUD103 error") < text.index("AUD110 warning")
    assert "5 of 12 episodes" in text
    assert text.count("set frame_dt") == 4
    assert "2 more: --verbose" in text
    assert render(FOUND, width=80, everything=True).count("set frame_dt") == 6
    assert "it ends at byte 7" in text
    assert max(map(len, text.splitlines())) <= 80
    assert text.rstrip().splitlines()[-2] == headline(FOUND)


@pytest.mark.parametrize(
    ("findings", "said"),
    [((), "12 episodes: nothing found"), (FOUND.findings, "5 errors, 1 warning, in 5 of them")],
)
def test_the_headline_counts(findings, said):
    assert said in headline(Audit(findings, 12, checks=FOUND.checks))


def test_json_has_every_field():
    found = json.loads(render(FOUND, "json"))
    assert found["counts"] == {"error": 5, "warning": 1, "note": 0}
    assert found["findings"][0] == {
        "code": "AUD103", "severity": "error", "episode": "episode 0", "path": "a.mcap",
        "bodies": ["cup"], "field": "frame_dt", "time": 1.5, "what": "frame_dt is 1 s.",
        "cause": "milliseconds", "fix": "set frame_dt = 0.01", "episodes": [],
    }  # fmt: skip
    assert found["problems"][0]["path"] == "b.mcap"


def test_junit_fails_by_errors_alone():
    suites = {
        suite.get("name").split()[0]: suite for suite in ET.fromstring(render(FOUND, "junit"))
    }
    assert suites["AUD103"].get("failures") == "5"
    assert suites["AUD104"].get("tests") == "1"
    assert (suites["AUD110"].get("failures"), suites["AUD110"].get("skipped")) == ("0", "1")
    assert suites["unreadable"].get("errors") == "1"


def test_github_has_a_line_per_finding():
    lines = render(FOUND, "github").splitlines()
    assert len(lines) == 7
    assert lines[0].startswith("::error title=AUD103 episode 0::frame_dt is 1 s. Likely")
    assert "::warning title=AUD110 episode 0::50 %25 too rare" in lines[5]


@pytest.mark.parametrize("form", FORMATS)
def test_names_from_traces_cannot_write_to_the_terminal(form):
    place = Place("\x1b[2Jevil", "a", field="x")
    bad = Finding("AUD103", "error", place, "a\x1b[31mb.", "", "c")
    assert "\x1b" not in render(Audit((bad,), 1, checks=("AUD103",)), form)


@pytest.mark.parametrize(("level", "fails"), [("error", True), ("warning", True), ("never", False)])
def test_what_fails_a_build(level, fails):
    assert FOUND.fails(level) is fails
    assert not Audit((finding(0, severity="note"),), 1).fails(level)


def test_every_check_can_be_explained():
    from safestage_eval.report.audit_report import explain

    for check in choose():
        assert check.code in explain(check)
        assert check.why in explain(check)
