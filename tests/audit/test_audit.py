"""The frame of the audit: declared checks, chosen checks, findings, and what happens to broken files."""

import shutil
from pathlib import Path

import pytest

from safestage_eval.audit import CHECKS, Defect, audit, check, choose
from safestage_eval.audit.audit_episode import check_subject
from safestage_eval.errors import InputError
from safestage_eval.formats import discover
from safestage_eval.report.audit_page import page

TRACES = Path(__file__).parents[2] / "traces"


def declared(code, run, **more):
    text = {"title": "t", "why": "w", "example": "e"}
    check(code, "warning", **text, **more)(run)
    return CHECKS.pop(code)


class Somebody:
    class header:  # noqa: N801
        episode_id = "e"


def test_every_check_says_what_it_does():
    for one in choose():
        assert one.how.endswith(".") and one.why.endswith("."), one.code
        assert one.title and one.example, one.code
        assert all(code in CHECKS for code in one.unless), one.code


def test_a_code_is_declared_once_and_says_of_what_it_is():
    choose()
    taken = next(iter(CHECKS))
    for code in (taken, "AUD1", "AUD401", "X101"):
        with pytest.raises(ValueError, match=code):
            check(code, "error", title="", why="", example="")


def test_checks_are_chosen_by_code_and_by_how_codes_begin():
    every = [one.code for one in choose()]
    assert [one.code for one in choose(["aud1"])] == [c for c in every if c.startswith("AUD1")]
    assert [one.code for one in choose(ignore=["AUD1"])] == [c for c in every if c[3] != "1"]
    with pytest.raises(InputError, match="AUD103"):
        choose(["AUD1O3"])


@pytest.mark.parametrize(
    ("first", "second", "left"),
    [((), ("a",), 1), (("a",), ("a", "b"), 1), (("a",), ("b",), 2), (("a",), (), 1)],
)
def test_what_another_check_explains_is_not_reported(first, second, left):
    one = declared("AUD198", lambda _: iter([Defect("x", "y", bodies=first)]))
    two = declared("AUD199", lambda _: iter([Defect("x", "y", bodies=second)]), unless=("AUD198",))
    assert len(check_subject(Somebody(), [one, two])) == left


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_broken_file_costs_no_other(tmp_path, jobs):
    whole = next(TRACES.glob("*.mcap"))
    for name in ("a", "b"):
        shutil.copy(whole, tmp_path / f"{name}.mcap")
    broken = tmp_path / "b.mcap"
    broken.write_bytes(broken.read_bytes()[:5000])
    found = audit(tmp_path, jobs=jobs)
    assert found.episodes == 2
    assert [problem.path for problem in found.problems] == [str(broken)]


def test_findings_come_in_order_whatever_the_number_of_processes():
    assert audit(TRACES, jobs=1) == audit(TRACES, jobs=2)
    assert audit(TRACES, jobs=1).episodes == len(discover(TRACES))


def test_the_page_is_that_of_the_declared_checks():
    written = (TRACES.parent / "docs" / "audit.md").read_text("utf-8")
    assert written == page(), "make audit-docs"
