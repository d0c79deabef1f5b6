"""SARIF as code scanning takes it: the properties that its specification asks for, and no name that breaks it."""

import json
import re

import jsonschema
import pytest
from studio import run, safe_and_unsafe


def an_object(*required, **properties):
    return {"type": "object", "required": [*required], "properties": properties}


def many(items, **more):
    return {"type": "array", "items": items, **more}


TEXT = an_object("text", text={"type": "string", "minLength": 1})
NAME = {"type": "string"}
URI = {"type": "string", "pattern": r"^[!#-;=?-\[\]_a-z~]+$"}
PLACE = an_object(
    "artifactLocation", "region",
    artifactLocation=an_object("uri", uri=URI),
    region=an_object(startLine={"type": "integer", "minimum": 1}),
)  # fmt: skip
LOCATION = an_object(
    "physicalLocation",
    physicalLocation=PLACE,
    logicalLocations=many(an_object(name=NAME, kind=NAME)),
)
LEVEL = {"enum": ["none", "note", "warning", "error"]}
RULE = an_object(
    "id",
    "shortDescription",
    "help",
    id=NAME,
    shortDescription=TEXT,
    fullDescription=TEXT,
    help=TEXT,
)
DRIVER = an_object("name", name=NAME, rules=many(RULE, uniqueItems=True))
NOTIFICATION = an_object("message", level=LEVEL, message=TEXT, locations=many(LOCATION))
RESULT = an_object(
    "message", "ruleId", "locations",
    message=TEXT, ruleId=NAME, ruleIndex={"type": "integer", "minimum": 0}, level=LEVEL,
    locations=many(LOCATION, minItems=1),
    partialFingerprints={"type": "object", "additionalProperties": NAME},
)  # fmt: skip
RUN = an_object(
    "tool", "results",
    tool=an_object("driver", driver=DRIVER),
    invocations=many(
        an_object(
            "executionSuccessful",
            executionSuccessful={"type": "boolean"},
            toolExecutionNotifications=many(NOTIFICATION),
        )
    ),
    columnKind={"enum": ["utf16CodeUnits", "unicodeCodePoints"]},
    results=many(RESULT),
)  # fmt: skip
SARIF = an_object(
    "version", "runs",
    **{"$schema": {"type": "string", "format": "uri"}}, version={"const": "2.1.0"}, runs=many(RUN),
) | {"additionalProperties": False}  # fmt: skip
"""Properties that SARIF 2.1.0 (sections 3.13 to 3.58) and GitHub's code scanning require."""


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    folder = safe_and_unsafe(tmp_path_factory.mktemp("traces"))
    (folder / "broken \x1b[31m\u00fc.mcap").write_bytes(b"\x89MCAP0\r\n")
    return folder


def document(*words):
    text = run(*words).text
    assert text.isprintable() or not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f]", text)
    found = json.loads(text)
    jsonschema.validate(found, SARIF, cls=jsonschema.Draft7Validator)
    (only,) = found["runs"]
    for result in only["results"]:
        rule = only["tool"]["driver"]["rules"][result["ruleIndex"]]
        assert rule["id"] == result["ruleId"]
    return only


def test_a_violation_is_an_error_at_its_trace(traces):
    found = document("score", traces, "--rules", "fsh", "-f", "sarif")
    errors = [result for result in found["results"] if result["level"] == "error"]
    assert [result["ruleId"] for result in errors] == ["FSH101"]
    (place,) = errors[0]["locations"]
    assert place["physicalLocation"]["artifactLocation"]["uri"].endswith("/unsafe.mcap")
    assert place["logicalLocations"] == [{"name": "unsafe", "kind": "episode"}]
    rule = next(r for r in found["tool"]["driver"]["rules"] if r["id"] == "FSH101")
    assert rule["help"]["text"] != rule["shortDescription"]["text"]
    assert errors[0]["properties"]["verdict"] == "violation"


def test_what_cannot_be_read_is_a_notification(traces):
    (invocation,) = document("score", traces, "--rules", "fsh", "-f", "sarif")["invocations"]
    assert not invocation["executionSuccessful"]
    (problem,) = invocation["toolExecutionNotifications"]
    assert "before its footer" in problem["message"]["text"]


def test_paths_are_below_the_folder_of_the_command(traces, monkeypatch):
    monkeypatch.chdir(traces.parent)
    found = document("score", traces, "--rules", "fsh", "-f", "sarif")
    for result in found["results"]:
        location = result["locations"][0]["physicalLocation"]["artifactLocation"]
        assert location["uriBaseId"] == "%SRCROOT%"
        assert not location["uri"].startswith("/")


def test_fingerprints_are_the_same_each_time_and_differ_between_findings(traces):
    both = [document("score", traces, "--rules", "fsh", "-f", "sarif") for _ in range(2)]
    prints = [[tuple(r["partialFingerprints"].values()) for r in one["results"]] for one in both]
    assert prints[0] == prints[1]
    assert len(set(prints[0])) == len(prints[0])


def test_the_audit_speaks_it_too(traces):
    found = document("audit", traces, "-f", "sarif", "--rules", "fsh")
    assert found["tool"]["driver"]["rules"]
    assert {r["level"] for r in found["results"]} <= {"error", "warning", "note"}
