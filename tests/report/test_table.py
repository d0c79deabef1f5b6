"""One table, written in each of its formats."""

import json
import math

from hypothesis import example, given, settings
from hypothesis import strategies as st
from rich.cells import cell_len

from safestage_eval.report.document import render_json
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


WORDS = st.lists(st.text("abcdefg_./", min_size=1, max_size=9), max_size=9).map(" ".join)


@given(
    st.lists(st.tuples(WORDS, WORDS, *[st.floats(0, 99).map("{:.1f} 3/7".format)] * 9, WORDS),
             min_size=1, max_size=4),
    st.integers(30, 90),
)  # fmt: skip
@example([("_" * 9, "_" * 9, *["0.0 3/7"] * 9, "_" * 9)], 30)
@settings(max_examples=40)
def test_a_table_fits_and_loses_or_breaks_no_word(rows, width):
    head = ("name", "a long head", *(f"share {i} of all" for i in range(9)), "what was seen")
    table = Table("Some title", head, rows, 2, texts=1)
    lines = text_lines(table, width)
    assert max(map(cell_len, lines)) <= width
    words = {word for row in [head, *rows] for cell in row for word in cell.split()}
    shown = {word for line in lines for word in line.split() if "─" not in word}
    assert shown == words | {"Some", "title"}
    for row in rows:  # numbers are not folded
        assert all(any(number in line for line in lines) for number in row[2:11])


def test_names_stand_before_every_part_of_a_table_that_is_too_wide():
    head = ("policy", *(f"column{i}" for i in range(12)))
    table = Table("", head, [["pi0", *"123456789012"], ["act", *"abcdefghijkl"]], 1)
    lines = text_lines(table, 40)
    assert sum(line.startswith("pi0") for line in lines) == len([*filter(None, lines)]) / 3 > 1
    assert "".join(line[6:].replace(" ", "") for line in lines if line.startswith("act")) == (
        "abcdefghijkl"
    )
    assert text_lines(table, 400) == text_lines(table)


def test_numbers_that_json_lacks_are_null():
    found = json.loads(render_json({"a": [math.inf, (math.nan, 1.5)], "b": {"c": -math.inf}}))
    assert found == {"a": [None, [None, 1.5]], "b": {"c": None}}
