"""One table, written in each of its formats."""

import json
import math

from rich.cells import cell_len

from safestage_eval.report.render_json import render_json
from safestage_eval.report.render_latex import render_latex
from safestage_eval.report.render_markdown import markdown_lines
from safestage_eval.report.render_text import text_lines
from safestage_eval.report.table import Table

TABLE = Table(
    "Rates", ("policy", "prompt", "VR %", "why"),
    [["pi0", "default", "5", "少し"], ["pi0", "generic", "12.5", "ok"], ["手", "default", "1", ""]],
    2, texts=1, grouped=True,
)  # fmt: skip


def test_columns_of_text_stand_under_each_other():
    title, head, rule, *rows = text_lines(TABLE)
    assert title == "Rates"
    ends = cell_len(head[: head.index("VR %")]) + 4
    for row, number in zip(rows, ("5", "12.5", "1"), strict=True):
        assert cell_len(row[: row.index(number)] + number) == ends
    assert len(rule) == max(map(cell_len, (head, *rows)))


def test_a_repeated_name_is_left_out_of_text_and_latex_alone():
    assert [row.startswith("pi0") for row in text_lines(TABLE)[3:]] == [True, False, False]
    assert render_latex([TABLE]).count("pi0") == 1
    assert sum("pi0" in line for line in markdown_lines(TABLE)) == 2


def test_numbers_are_right_aligned_in_markdown():
    assert markdown_lines(TABLE)[1] == "|---|---|---:|---|"


def test_a_group_begins_with_a_rule_in_latex():
    assert render_latex([TABLE]).count("\\midrule") == 2


def test_numbers_that_json_lacks_are_null():
    found = json.loads(render_json({"a": [math.inf, (math.nan, 1.5)], "b": {"c": -math.inf}}))
    assert found == {"a": [None, [None, 1.5]], "b": {"c": None}}
