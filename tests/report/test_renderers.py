"""Every format says the same as the rows that it is made of."""

import csv
import io
import json
import math
import re
from collections import Counter
from dataclasses import replace
from xml.etree import ElementTree as ET

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


def test_parquet_read_by_polars():
    found = pl.read_parquet(io.BytesIO(render(scores(), "parquet")))
    assert tuple(found.columns) == COLUMNS
    assert found.to_dicts() == rows(scores())


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
    table = table[next(i for i, line in enumerate(table) if line.startswith("| policy")) :]
    head, _, *body = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    assert all(len(cells) == len(head) for cells in body)
    found = {tuple(cells[:3]): cells[3:] for cells in body}
    for name, cell in by_policy_stage(outcomes(scores().results)).items():
        assert (head[3], found[name][0]) == ("episodes", str(cell.n + cell.inconclusive))
        for column, shown in zip(head[4:], found[name][1:], strict=True):
            bounds = cell.bounds(column.split()[0])
            ends = [float(end) for end in re.findall(r"[\d.]+", shown)]
            if bounds is None:
                assert shown == "–"
            else:
                assert (ends[0], ends[-1]) == pytest.approx([100 * end for end in bounds], abs=0.06)
                assert len(ends) == 1 + (f"{100 * bounds[0]:.1f}" != f"{100 * bounds[1]:.1f}")
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
            "".join(results_text.render(scores(), width=columns, everything=True).split())
        )

    assert not letters(300) - letters(width)  # names stand before every part of a wide table


def test_table_tells_what_happened():
    text = results_text.render(scores(), everything=True)
    result = squeezed(text)
    for name, v in assigned("violation", "inconclusive"):
        assert name in result
        assert v.rule in result
        assert squeezed(v.explanation) in result
    assert "2.50 s" in result
    assert "1 undecided" in result
    assert "2 episodes not judged" in result  # one has no assigned rule, the other's was not loaded
    assert "FSH101" in result.partition("not judged")[2]
    assert "success disagrees" in result
    assert squeezed(scores().problems[0].message) in result
    assert "\x1b" not in text


def test_the_headline_counts_every_recorded_episode():
    """Four judged and one that cannot be read; SR: one, two and three of them, and four has none."""
    first, second, *_ = render(scores(), "table").splitlines()
    assert first == "VR 20–60 % (1 of 5 violated, 1 undecided, 1 not readable)"
    assert second == "SR 60–80 %, SSR 20–60 %, USR 20–60 % of 5 episodes; 3 met the hazard"


def shown(text, results):
    return [r for r in results if re.search(rf"\b{r.episode_id}\b", text)]


def several(prefix, count, verdict):
    return [episode(f"{prefix}{i:03d}", verdict) for i in range(count)]


def test_twenty_episodes_fit_a_screen():
    bad = [
        episode(f"bad{i:03d}", replace(VIOLATION, rule=f"FSH1{i % 3:02d}", margin_normalised=-i))
        for i in range(12)
    ]
    good, open_ = several("good", 5, PASS), several("open", 3, INCONCLUSIVE)
    together = Scores((*good, *open_, *bad))
    text = results_text.render(together, width=80, traces="traces/")
    assert len(text.splitlines()) <= 45
    assert [r.episode_id for r in shown(text, bad)] == [f"bad{i:03d}" for i in range(6, 12)]
    assert "Violations: 12, 6 more with -v" in text
    *_, said, after = text.splitlines()
    assert said == "12 of 20 successes were unsafe · 5 safe · 3 undecided"
    assert after == "next: safestage view traces/"
    whole = results_text.render(together, everything=True)
    assert len(shown(whole, together.results)) == len(together.results)


FORCELESS = replace(
    INCONCLUSIVE, rule="ETS103",
    explanation="Cannot be decided: the trace has no contact forces. Record contact forces.",
)  # fmt: skip


def test_a_rule_that_these_recordings_cannot_decide_is_one_line():
    """It would leave every episode open that no other rule is violated in: VR 25–100 %."""
    bad = episode("bad", VIOLATION, FORCELESS)
    some = Scores((bad, *(episode(f"good{i}", PASS, FORCELESS) for i in range(3))))
    text = results_text.render(some)
    assert text.startswith("VR 25 % (1 of 4 violated)\n")
    assert squeezed(text).count("ETS103") == 1
    assert "ETS103. To decide: record contact forces; --strict counts" in squeezed(text)
    strict_ = results_text.render(replace(some, strict=True))
    assert strict_.startswith("VR 25–100 % (1 of 4 violated, 3 undecided)\n")
    decided = episode("decided", PASS, replace(PASS, rule="ETS103"))
    mixed = results_text.render(replace(some, results=(*some.results, decided)))
    assert mixed.startswith("VR 20–80 % (1 of 5 violated, 3 undecided)\n")


def test_an_episode_that_nothing_else_judges_stays_undecided():
    text = results_text.render(Scores((episode("one", FORCELESS), episode("two", PASS))))
    assert text.startswith("VR 0–50 % (0 of 2 violated, 1 undecided)\n")


def test_own_data_have_the_stage_of_their_rules():
    own = replace(episode("one", VIOLATION, replace(PASS, rule="ETS101", stage="ETS")), stage=None)
    assert own.judged_stage == "ETS+FSH"
    assert {row["stage"] for row in own.rows()} == {"ETS+FSH"}


def test_other_stages_findings_on_request():
    assert "it followed" not in render(scores(), "table")
    text = squeezed(results_text.render(scores(), everything=True))
    assert "it followed" in text
    assert "follows FSH101" in text


def test_names_are_not_markup():
    named = episode("[red]one[/red]", VIOLATION, policy="[bold]pi")
    text = render(Scores((named, episode("two", PASS))), "table")
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
    two = Scores((episode("one", absent), episode("two", PASS)))
    text = results_text.render(two, everything=True)
    heads = re.findall(r"^(\w.*): (\d) of 2 episodes", text, re.MULTILINE)
    assert heads == [
        ("Hazard not met, counted as no violation", "1"), ("Safe", "1")
    ]  # fmt: skip
    assert "of 2 episodes; 1 met the hazard\n" in text
    mixed = results_text.render(Scores((episode("one", absent, PASS),)), everything=True)
    assert "Safe: 1 of 1" in mixed


@pytest.mark.parametrize("form", ["table", "markdown"])
def test_undecided_episodes_stay_in_the_denominator(form):
    """Two safe of two decided, of seventeen: nothing says SSR 100 % or VR 0 %."""
    safe = [episode(f"safe {i}", PASS) for i in range(2)]
    undecided = [episode(f"open {i}", INCONCLUSIVE) for i in range(15)]
    text = render(Scores((*safe, *undecided)), form)
    assert text.lstrip("*").startswith("VR 0–88.2 % (0 of 17 violated, 15 undecided)")
    assert "SSR 11.8–100 %, USR 0–88.2 % of 17 episodes" in text


def test_a_pass_never_has_the_colour_of_a_violation():
    """Not beside the violation of the same episode either, nor with a severity or little margin."""
    close = replace(PASS, margin=1e-6, severity="serious")
    text = results_text.render(
        Scores((episode("one", VIOLATION, close),)), color=True, everything=True
    )
    colours = {word: code for code, word in re.findall(r"\x1b\[([\d;]+)m(violation|pass)\b", text)}
    near = {
        word: Color.parse(TERMINAL[word]).downgrade(ColorSystem.EIGHT_BIT).number
        for word in ("violation", "pass")
    }
    assert colours == {word: f"38;5;{number}" for word, number in near.items()}
    assert colours["pass"] != colours["violation"]


def test_a_stage_of_which_nothing_was_judged_has_no_row_of_rates():
    unjudged = replace(VIOLATION, assigned=False)
    judged = [scores().results[0], episode("two", PASS, policy="act")]
    text = results_text.render(Scores((*judged, episode("other", unjudged, stage="ISH"))))
    rates = text.partition("policy")[2]
    assert "FSH" in rates
    assert "ISH" not in rates
