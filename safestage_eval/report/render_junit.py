"""Test cases as JUnit XML."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple
from xml.etree import ElementTree as ET

from safestage_eval._text.printable import printable_lines

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold, not even escaped (XML 1.0, section 2.2)."""


class Case(NamedTuple):
    """One test case.

    Attributes:
        classname, name: of the case.
        outcome: how it failed; empty if it passed.
        message: why.
        detail: more on a failure, in lines.
    """

    classname: str
    name: str
    outcome: Literal["", "failure", "skipped", "error"] = ""
    message: str = ""
    detail: str = ""


def render_junit(name: str, suites: Mapping[str, Sequence[Case]]) -> str:
    """The document: suites with their cases and counts."""
    root = ET.Element("testsuites", name=name)
    for suite, cases in suites.items():
        node = ET.SubElement(root, "testsuite", name=suite)
        for case in cases:
            element = ET.SubElement(node, "testcase", classname=case.classname, name=case.name)
            if case.outcome:
                ET.SubElement(element, case.outcome, message=case.message).text = (
                    case.detail or None
                )
        outcomes = [case.outcome for case in cases]
        node.set("tests", str(len(cases)))
        for key, outcome in (("failures", "failure"), ("skipped", "skipped"), ("errors", "error")):
            node.set(key, str(sum(one == outcome for one in outcomes)))
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
    return printable_lines(_NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text))
