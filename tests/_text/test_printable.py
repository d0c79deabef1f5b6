"""Nothing that a trace or a rule file says moves the cursor or turns the writing direction."""

import csv
import io
import re
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval._text.printable import printable, printable_lines
from safestage_eval.report.document import Document, render_csv
from safestage_eval.report.table import Table

HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202egnp.exe\u2066\r\n\x9b31m\udcff\u200b"
HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}


def shows_all(text):
    return not {unicodedata.category(c) for c in text} & HIDDEN


@given(st.text())
def test_every_character_is_seen(text):
    assert shows_all(printable(text))


@given(st.text(st.characters(exclude_categories=sorted(HIDDEN))))
def test_what_is_seen_stays(text):
    assert printable(text) == text


@given(st.text())
def test_lines_stay_lines(text):
    found = printable_lines(text).split("\n")
    assert len(found) == text.count("\n") + 1
    assert all(shows_all(line.replace("\t", "")) for line in found)


@pytest.mark.parametrize("form", ["table", "markdown", "latex"])
def test_a_hostile_name_in_a_table(form):
    table = Table(HOSTILE, ("name", "k"), [[HOSTILE, "1"], [HOSTILE, "2"]], 1)
    assert all(shows_all(line) for line in Document([table], [HOSTILE]).render(form).split("\n"))


def test_a_hostile_name_in_rows():
    text = render_csv([{"name": HOSTILE}])
    assert all(shows_all(line) for line in text.split("\n"))
    assert next(csv.DictReader(io.StringIO(text))) == {"name": printable(HOSTILE)}


def test_cells_cannot_break_out_of_a_markdown_table():
    table = Table("", ("name",), [["a | b\n| c |"], ["<script>alert(1)</script>"]], 1)
    text = Document([table]).render("markdown")
    lines = text.splitlines()
    assert all(len(re.findall(r"(?<!\\)\|", line)) == 2 for line in lines if line)
    assert "<script" not in text.replace("\\<", "")
