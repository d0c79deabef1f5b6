"""Every format says the same as the rows that it is made of."""

import csv
import io
import json
import math
import re
from collections import Counter
from dataclasses import replace
from xml.etree import ElementTree as ET

import pandas as pd
import polars as pl
import pytest
from fabricated import INCONCLUSIVE, NOT_APPLICABLE, PASS, VIOLATION, episode, scores
from rich.color import Color, ColorSystem

from safestage_eval._text.printable import printable
from safestage_eval.metrics import by_policy_stage, outcomes
from safestage_eval.palette import TERMINAL
from safestage_eval.report import FORMATS, render, results_text
from safestage_eval.report.result_rows import COLUMNS, rows
from safestage_eval.run.scores import Scores
from safestage_eval.units import DIMENSIONS

LISTS = ("bodies", "intervals", "notes")


def strict(text):
    """JSON without NaN and Infinity, which are no JSON."""

    def refuse(constant):
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def assigned(*verdicts):
    return [
        (r.episode_id, v)
        for r in scores().results
        for v in r.assigned
        if not verdicts or v.verdict in verdicts
    ]


def test_rows_have_the_documented_columns():
    found = rows(scores())
    assert len(found) == sum(len(r.verdicts) + len(r.not_loaded) for r in scores().results)
    assert all(tuple(row) == COLUMNS for row in found)


def test_values_are_in_the_unit_beside_them():
    row = rows(scores())[0]
    factor = DIMENSIONS["length"][row["unit"]]
    for name, si in (("value", 0.004), ("limit", 0.02), ("margin", -0.016)):
        assert math.isclose(row[name] * factor, si)


def test_json():
    found = strict(render(scores(), "json"))
    assert list(found) == ["version", "rules", "episodes", "metrics", "problems"]
    assert found["episodes"] == rows(scores())
    assert found["rules"] == scores().rules
    assert found["problems"] == [{"path": p.path, "message": p.message} for p in scores().problems]
    by_stage = {(r["prompt"], r["stage"], r["metric"]): r for r in found["metrics"]["by_stage"]}
    assert by_stage["default", "FSH", "SR"]["n"] == 3  # one, two and four are decided


def test_json_lines():
    assert [strict(line) for line in render(scores(), "jsonl").splitlines()] == rows(scores())


def test_csv():
    found = list(csv.DictReader(io.StringIO(render(scores(), "csv"))))
    assert tuple(found[0]) == COLUMNS
    for cells, row in zip(found, rows(scores()), strict=True):
        for name, value in row.items():
            if name in LISTS:
                assert strict(cells[name]) == value
            elif isinstance(value, bool):
                assert cells[name] == str(value).lower()
            elif isinstance(value, float):
                assert float(cells[name]) == value
            else:
                assert cells[name] == ("" if value is None else printable(str(value)))


def test_csv_read_by_pandas():
    found = pd.read_csv(io.StringIO(render(scores(), "csv")))
    for name in ("value", "time", "margin"):
        wanted = [math.nan if row[name] is None else row[name] for row in rows(scores())]
        pd.testing.assert_series_equal(found[name], pd.Series(wanted), check_names=False)
    assert list(found["success"].dropna()) == [
        r["success"] for r in rows(scores()) if r["success"] is not None
    ]


def test_parquet_read_by_polars():
    found = pl.read_parquet(io.BytesIO(render(scores(), "parquet")))
    assert tuple(found.columns) == COLUMNS
    assert found.to_dicts() == rows(scores())


def test_parquet_read_by_pandas():
    found = pd.read_parquet(io.BytesIO(render(scores(), "parquet")))
    assert [v if isinstance(v, str) else None for v in found["verdict"]] == [
        row["verdict"] for row in rows(scores())
    ]
    assert list(found["value"].dropna()) == [
        row["value"] for row in rows(scores()) if row["value"] is not None
    ]
    assert [list(map(list, i)) for i in found["intervals"]] == [
        row["intervals"] for row in rows(scores())
    ]


def test_parquet_has_one_schema_whatever_the_rows_hold():
    few = Scores((episode("five", INCONCLUSIVE, success=None, seed=None),))
    schemas = [
        pl.read_parquet_schema(io.BytesIO(render(s, "parquet"))) for s in (scores(), few, Scores())
    ]
    assert schemas[0] == schemas[1] == schemas[2]


def test_junit():
    root = ET.fromstring(render(scores(), "junit"))
    cases = {}
    for suite in root:
        assert int(suite.get("tests")) == len(suite.findall("testcase"))
        assert int(suite.get("failures")) == len(suite.findall("testcase/failure"))
        assert int(suite.get("errors")) == len(suite.findall("testcase/error"))
        assert int(suite.get("skipped")) == len(suite.findall("testcase/skipped"))
        for case in suite:
            assert case.get("classname").startswith(suite.get("name"))
            cases[case.get("name"), case.get("classname").rpartition(".")[2]] = case
    for name, v in assigned():
        case = cases.pop((name, v.rule))
        kind = {"violation": "failure", "inconclusive": "skipped"}.get(v.verdict)
        assert [child.tag for child in case] == ([kind] if kind else [])
        if kind:
            assert case[0].get("message") == v.explanation
    absent = cases.pop(("six", "FSH101"))
    assert (absent[0].tag, "not loaded" in absent[0].get("message")) == ("skipped", True)
    (problem,) = cases.values()
    assert problem[0].tag == "error"
    assert problem[0].get("message") == scores().problems[0].message


def test_junit_of_names_that_xml_cannot_hold():
    root = ET.fromstring(render(Scores((episode("a\x00\x1b<&>b é 🥚", VIOLATION),)), "junit"))
    assert root.find(".//testcase").get("name") == "a��<&>b é 🥚"


def test_github_annotations():
    lines = render(scores(), "github").splitlines()
    found = [re.fullmatch(r"::(error|warning) title=([^:,]*)::(.*)", line) for line in lines]
    assert all(found)

    def plain(text):
        for code, raw in (("%3A", ":"), ("%2C", ","), ("%0A", "\n"), ("%0D", "\r"), ("%25", "%")):
            text = text.replace(code, raw)
        return text

    wanted = [
        ("error" if v.verdict == "violation" else "warning", v.explanation)
        for _, v in assigned("violation", "inconclusive")
    ]
    wanted.append(("warning", "it is assigned and was not loaded"))
    wanted.append(("error", scores().problems[0].message))
    assert [(m[1], plain(m[3])) for m in found] == wanted


def test_markdown():
    text = render(scores(), "markdown")
    table = [line for line in text.splitlines() if line.startswith("|")]
    head, _, *body = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    assert all(len(cells) == len(head) for cells in body)
    found = {tuple(cells[:3]): cells[3:] for cells in body}
    for name, cell in by_policy_stage(outcomes(scores().results)).items():
        assert (head[3], found[name][0]) == ("judged", f"{cell.n}/{cell.episodes}")
        for column, shown in zip(head[4:], found[name][1:], strict=True):
            metric = column.split()[0]
            counts = re.search(r"(\d+)/(\d+)", shown)
            if cell.n:
                assert (int(counts[1]), int(counts[2])) == (cell.counts[metric], cell.n)
                assert abs(float(shown.split()[0]) - 100 * cell.value(metric)) < 0.06
            else:
                assert counts is None
    bullets = [line for line in text.splitlines() if line.startswith("- ")]
    assert len(bullets) == len(assigned("violation", "inconclusive")) + 1
    for name, v in assigned("violation", "inconclusive"):
        assert f"**{v.rule}** `{name}`" in text


@pytest.mark.parametrize("form", FORMATS)
def test_nothing_scored_is_rendered_as_well(form):
    assert render(Scores(), form) is not None


def test_an_unknown_format():
    with pytest.raises(KeyError):
        render(Scores(), "yaml")


# ---- the table


def squeezed(text):
    return " ".join(text.split())


@pytest.mark.parametrize("width", [20, 40, 50, 51, 80])
def test_a_narrow_terminal_loses_no_letter(width):
    """Sentences and names are wrapped."""

    def letters(columns):
        return Counter(
            "".join(results_text.render(scores(), width=columns).replace("─", "").split())
        )

    assert not letters(300) - letters(width)  # names stand before every part of a wide table


def test_table_tells_what_happened():
    text = render(scores(), "table")
    result = squeezed(text)
    for name, v in assigned("violation", "inconclusive"):
        assert name in result
        assert v.rule in result
        assert squeezed(v.explanation) in result
    assert "2.50 s" in result
    assert "1 inconclusive" in result
    assert "2 episodes not judged" in result  # one has no assigned rule, the other's was not loaded
    assert "FSH101" in result.partition("not judged")[2]
    assert "success disagrees" in result
    assert squeezed(scores().problems[0].message) in result
    assert "\x1b" not in text


def test_table_counts_k_of_n():
    """Three of five judged. SR: one and two of one, two and four; SSR, USR, VR: one of them."""
    line = next(li for li in render(scores(), "table").splitlines() if re.search(r"FSH .*/3", li))
    assert re.findall(r"(\d+)/(\d+)", line) == [
        ("3", "5"), ("2", "3"), ("1", "3"), ("1", "3"), ("1", "3")
    ]  # fmt: skip
    assert re.findall(r"\d+\.\d", line) == ["66.7", "33.3", "33.3", "33.3"]


def shown(text, results):
    return [r for r in results if re.search(rf"\b{r.episode_id}\b", text)]


def several(prefix, count, verdict):
    return [episode(f"{prefix}{i:03d}", verdict) for i in range(count)]


def test_every_episode_is_shown_up_to_the_limit():
    many = several("good", results_text.MOST, PASS)
    text = render(Scores(tuple(many)), "table")
    assert shown(text, many) == many
    assert "--verbose" not in text


def test_beyond_the_limit_findings_come_first_and_the_rest_is_counted():
    good, bad = several("good", results_text.MOST, PASS), several("bad", 5, VIOLATION)
    open_ = several("open", 3, INCONCLUSIVE)
    together = Scores((*good, *open_, *bad))
    text = render(together, "table")
    assert shown(text, bad) == bad
    assert shown(text, open_) == open_
    assert text.index("bad000") < text.index("open000")
    for count in (len(bad), len(open_), len(good)):
        assert f"{count} of {len(together.results)}" in text
    assert "--verbose" in text
    whole = results_text.render(together, everything=True)
    assert len(shown(whole, together.results)) == len(together.results)


def test_what_is_left_out_is_counted():
    bad = several("bad", results_text.MOST + 7, VIOLATION)
    text = render(Scores(tuple(bad)), "table")
    assert shown(text, bad) == bad[: results_text.MOST]
    assert "7 more" in text


def test_other_stages_findings_on_request():
    assert "it followed" not in render(scores(), "table")
    text = squeezed(results_text.render(scores(), everything=True))
    assert "it followed" in text
    assert "follows FSH101" in text


@pytest.mark.parametrize("width", [50, 80])
def test_narrow_terminals_lose_nothing(width):
    """Lines are wrapped, never cut."""
    words = [f"word{i}" for i in range(40)]
    long = replace(VIOLATION, explanation=" ".join(words))
    text = results_text.render(Scores((episode("one", long),)), width=width)
    assert "…" not in text
    assert all(word in text for word in words)
    assert all(len(line) <= width for line in text.splitlines())


def test_names_are_not_markup():
    text = render(Scores((episode("[red]one[/red]", VIOLATION, policy="[bold]pi"),)), "table")
    assert "[red]one[/red]" in text
    assert "[bold]pi" in text


def test_colours_only_when_asked():
    assert "\x1b[" in results_text.render(scores(), color=True)


# ---- numbers without end


@pytest.mark.parametrize("endless", [math.inf, -math.inf, math.nan])
def test_what_has_no_size_is_left_open(endless):
    """Also where a value could not be measured to its end: JSON knows neither NaN nor infinity."""
    far = replace(VIOLATION, value=endless, margin=endless, margin_normalised=endless)
    some = Scores((episode("one", far),))
    (row,) = strict(render(some, "json"))["episodes"]
    assert [row[name] for name in ("value", "margin", "margin_normalised")] == [None] * 3
    assert row["limit"] == 2.0
    for form in FORMATS:
        assert render(some, form)


def test_an_absent_hazard_is_not_called_safe():
    absent = replace(NOT_APPLICABLE, assigned=True)
    text = results_text.render(Scores((episode("one", absent), episode("two", PASS))))
    heads = re.findall(r"^(\w.*): (\d) of 2 episodes", text, re.MULTILINE)
    assert heads == [
        ("Not at risk, counted as no violation", "1"), ("Safe", "1")
    ]  # fmt: skip
    assert text.startswith("Judged 2 of 2 episodes; at risk 1\n")
    mixed = results_text.render(Scores((episode("one", absent, PASS),)))
    assert "Safe: 1 of 1" in mixed


@pytest.mark.parametrize("form", ["table", "markdown"])
def test_coverage_comes_first_and_stands_beside_the_rates(form):
    """Two safe of two judged, of seventeen: no table says SSR 100 % without the seventeen."""
    safe = [episode(f"safe {i}", PASS) for i in range(2)]
    undecided = [episode(f"open {i}", INCONCLUSIVE) for i in range(15)]
    text = render(Scores((*safe, *undecided)), form)
    assert text.lstrip("*").startswith("Judged 2 of 17 episodes; at risk 2; inconclusive 15")
    with_rates = [line for line in text.splitlines() if "100.0 2/2" in line]
    assert with_rates
    assert all("2/17" in line for line in with_rates)


def test_a_pass_never_has_the_colour_of_a_violation():
    """Not beside the violation of the same episode either, nor with a severity or little margin."""
    close = replace(PASS, margin=1e-6, severity="serious")
    text = results_text.render(Scores((episode("one", VIOLATION, close),)), color=True)
    colours = {word: code for code, word in re.findall(r"\x1b\[([\d;]+)m(violation|pass)\b", text)}
    near = {
        word: Color.parse(TERMINAL[word]).downgrade(ColorSystem.EIGHT_BIT).number
        for word in ("violation", "pass")
    }
    assert colours == {word: f"38;5;{number}" for word, number in near.items()}
    assert colours["pass"] != colours["violation"]


def test_a_stage_of_which_nothing_was_judged_has_no_row_of_rates():
    unjudged = replace(VIOLATION, assigned=False)
    found = scores().results[0]
    both = Scores((found, episode("other", unjudged, stage="ISH")))
    rates = results_text.render(both).partition("Rates:")[2]
    assert "FSH" in rates
    assert "ISH" not in rates
