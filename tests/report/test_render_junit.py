"""JUnit XML counts the cases that it holds."""

from collections import Counter
from xml.etree import ElementTree as ET

from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.report.for_build_servers import Case, render_junit

CASES = st.builds(
    Case, st.text(), st.text(), st.sampled_from(["", "failure", "skipped", "error"]), st.text()
)


@given(st.dictionaries(st.text("abc", min_size=1), st.lists(CASES, max_size=5), max_size=3))
def test_every_case_is_there_and_counted(suites):
    root = ET.fromstring(render_junit("all", suites))
    assert [suite.get("name") for suite in root] == list(suites)
    for suite, cases in zip(root, suites.values(), strict=True):
        outcomes = Counter(case.outcome for case in cases)
        assert suite.get("tests") == str(len(cases)) == str(len(suite.findall("testcase")))
        assert (
            suite.get("failures")
            == str(outcomes["failure"])
            == str(len(suite.findall("*/failure")))
        )
        assert suite.get("errors") == str(outcomes["error"]) == str(len(suite.findall("*/error")))
        assert suite.get("skipped") == str(outcomes["skipped"])
