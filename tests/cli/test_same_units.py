"""A finding has the same unit wherever it is read: length, angle, force and speed."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest
from studio import run

import safestage_eval as sse
from safestage_eval.units import DIMENSIONS, in_unit, unit_of

TRACE = str(
    Path(__file__).parents[2]
    / "traces"
    / "ets_dumbbell_near_glasses.reference-unsafe.default.s0.r0.mcap"
)
UNITS = {"UNI101": "cm", "UNI102": "deg", "UNI103": "N", "UNI104": "cm/s"}
RULES = """\
[ruleset]
format  = 1
name    = "units"
version = "1"
extends = ["defaults"]

[[rule]]
code    = "UNI101"
title   = "Length"
roles   = { target = "object", protected = "object" }
require = { "clearance(target, protected)" = ">= 8 cm" }

[[rule]]
code    = "UNI102"
title   = "Angle"
roles   = { target = "object" }
require = { "turn(target)" = "<= 1 deg" }

[[rule]]
code    = "UNI103"
title   = "Force"
roles   = { target = "object" }
require = { "peak_force(gripper, target)" = "<= 1 N" }

[[rule]]
code    = "UNI104"
title   = "Speed"
roles   = { target = "object" }
require = { "speed(target)" = "<= 5 cm/s" }
"""


@pytest.fixture(scope="module")
def rules(tmp_path_factory):
    file = tmp_path_factory.mktemp("rules") / "units.toml"
    file.write_text(RULES, "utf-8")
    return str(file)


@pytest.fixture(scope="module")
def rows(rules):
    """Code → row of the CSV file."""
    text = run("score", TRACE, "--rules", rules, "--assign", "UNI1*", "-f", "csv").text
    found = {row["rule"]: row for row in csv.DictReader(io.StringIO(text))}
    assert {code: row["unit"] for code, row in found.items()} == UNITS
    return found


def said(row):
    """The value of a row as sentences say it: as many decimals as its limit has there."""
    (limit,) = re.findall(r"; at (?:least|most) ([\d.]+) ", row["explanation"])
    decimals = len(limit.partition(".")[2])
    return f"{float(row['value']):.{decimals}f} {row['unit']}"


@pytest.mark.parametrize("command", ["explain", "score"])
def test_words_have_the_units_of_files(rows, rules, command):
    text = run(command, TRACE, "--rules", rules, "--assign", "UNI1*").text
    for code, row in rows.items():
        assert f"{row['signal']} was {said(row)}" in text, code


def test_a_notebook_has_them_in_words_and_plots_and_si_in_rows(rows, rules):
    pytest.importorskip("matplotlib").use("Agg")
    scores = sse.score(TRACE, rules=rules, assign="UNI1*")
    for found in scores.findings:
        row = rows[found.rule]
        assert said(row) in found._repr_html_()
        (axes,) = found.plot().figure.axes
        assert axes.get_title("left") == f"{row['signal']} ({row['unit']})"
    dimensions = {unit_of(name): name for name in DIMENSIONS}
    assert set(rows) <= set(scores.rows.rule)
    for one in scores.rows[scores.rows.rule.isin(rows)].itertuples():
        row = rows[one.rule]
        assert in_unit(one.value, dimensions[row["unit"]]) == pytest.approx(float(row["value"]))
