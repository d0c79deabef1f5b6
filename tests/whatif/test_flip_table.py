"""Rows and what-if table answer as traces do, and open none where the table decides."""

import json
import shutil

import polars as pl
import pytest
from studio import block, run

from safestage_eval.errors import InputError
from safestage_eval.formats import discover, save
from safestage_eval.rules import load_rules
from safestage_eval.whatif.diff import diff, diff_table
from safestage_eval.whatif.flip_table import FlipTable, slack
from safestage_eval.whatif.sweep import sweep, sweep_table
from safestage_eval.whatif.swept_values import between, chosen

ROOMS = {"a": 0.004, "b": 0.012, "c": 0.031, "d": 0.2}
RULES = ["ets", "fsh"]


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    """Traces of blocks at different distances from the edge, and their rows with the table."""
    folder = tmp_path_factory.mktemp("scored")
    traces = folder / "traces"
    traces.mkdir()
    for i, (name, room) in enumerate(ROOMS.items()):
        rules = ("FSH101", "FSH103") if name == "d" else ("FSH101",)
        save(block(name, room=room, policy="xy"[i % 2], rules=rules), traces / f"{name}.mcap")
    save(block("e", rules=("ETS102",), stage="ETS"), traces / "e.mcap")
    done = run(
        "score", traces, "-r", "ets", "-r", "fsh", "-f", "parquet", "-o", folder / "rows.parquet",
        "--what-if", "all",
    )  # fmt: skip
    assert done.code == 0
    return folder


@pytest.mark.parametrize("param", ["edge", "still", "hold_time", "stance", "still_over"])
@pytest.mark.parametrize("by", [(), ("policy",), ("stage", "rule")])
def test_a_sweep_of_the_rows_is_one_of_the_traces(scored, param, by):
    values = between(load_rules(RULES), param, None, None, 9)
    table = sweep_table(FlipTable(scored / "rows.parquet"), param, values)
    traces = sweep(discover([scored / "traces"]), RULES, param, values)
    assert table.curves(by) == traces.curves(by)
    assert sorted(map(str, table.flips())) == sorted(map(str, traces.flips()))
    assert (table.count, table.unread, table.readers) == (
        traces.count, traces.unread, traces.readers
    )  # fmt: skip
    assert table.again == {"still_over": 2, "hold_time": 4}.get(param, 0)


def test_a_diff_of_the_rows_is_one_of_the_traces(scored):
    table = diff_table(FlipTable(scored / "rows.parquet"), {"edge": "1 cm"})
    found = diff(discover([scored / "traces"]), RULES, RULES, overrides={"edge": "1 cm"})
    assert [(f.episode_id, f.rule, f.before, f.after) for f in table.flips] == [
        ("b", "FSH101", "violation", "pass")
    ]
    assert [(f.episode_id, f.after) for f in found.flips if f.assigned] == [("b", "pass")]
    assert table.rates == found.rates
    assert table.flips[0].cause == "edge = 1 cm"


def test_without_traces_what_the_table_leaves_open_is_counted(scored, tmp_path):
    for name in ("rows.parquet", "rows.what-if.parquet"):
        shutil.copy(scored / name, tmp_path / name)
    rows = pl.read_parquet(tmp_path / "rows.parquet").with_columns(path=pl.lit("gone.mcap"))
    rows.write_parquet(tmp_path / "rows.parquet")
    table = FlipTable(tmp_path / "rows.parquet")
    values = chosen(load_rules(RULES), "hold_time", ["4 s"])
    found = sweep_table(table, "hold_time", values)
    ((cell,),) = found.curves().values()
    assert (found.undecided, cell.n, cell.inconclusive) == (4, 0, 4)
    assert "4 of these not decided" in found.remarks[0]
    flips = diff_table(table, {"hold_time": "4 s"})
    assert len(flips.problems) == 4
    assert not flips.flips
    (decided,) = sweep_table(table, "edge", chosen(load_rules(RULES), "edge", ["1 cm"])).curves()[
        ()
    ]
    assert (decided.n, decided.counts["VR"]) == (4, 1)


def test_slack_is_how_far_a_value_may_go(scored):
    found = slack(FlipTable(scored / "rows.parquet"), ["edge"]).sort("episode_id")
    ups, downs = found["up"].to_list(), found["down"].to_list()
    assert ups[:2] == [None, None]
    assert downs[0] == pytest.approx(0.016, abs=1e-5)
    assert downs[1] == pytest.approx(0.008, abs=1e-5)
    assert ups[2] == pytest.approx(0.011, abs=1e-5)
    assert found["to_up"].to_list()[2] == "violation"


def test_the_commands_take_rows(scored):
    done = run("sweep", scored / "rows.parquet", "-p", "edge", "--values", "1 cm", "-f", "json")
    assert done.code == 0
    (row,) = json.loads(done.text)["curve"]
    assert (row["n"], row["VR_k"]) == (4, 1)
    done = run("compare", "verdicts", scored / "rows.parquet", "--set", "edge=1 cm", "-f", "json")
    assert done.code == 0
    assert [flip["episode_id"] for flip in json.loads(done.text)["flips"]] == ["b"]


def test_rows_without_a_table_say_how_to_get_one(scored, tmp_path):
    alone = tmp_path / "alone.parquet"
    shutil.copy(scored / "rows.parquet", alone)
    with pytest.raises(InputError, match="no what-if table stands beside it"):
        FlipTable(alone)
    done = run("sweep", alone, "-p", "edge")
    assert done.code == 2
    assert "--what-if all" in done.err
    done = run("sweep", scored / "rows.parquet", "-r", "fsh", "-p", "edge")
    assert done.code == 2
    assert "leave out --rules" in done.err
