"""Every format gives the same outcomes, and files without any are refused in clear words."""

import tracemalloc
from dataclasses import replace

import polars as pl
import pytest
from campaign import campaign, frame

from safestage_eval.errors import InputError
from safestage_eval.metrics import aggregate, outcomes_of, read_outcomes

WRITERS = {
    "parquet": lambda table, path: table.to_parquet(path),
    "csv": lambda table, path: table.to_csv(path, index=False),
    "json": lambda table, path: table.to_json(path, orient="records"),
    "jsonl": lambda table, path: table.to_json(path, orient="records", lines=True),
}

ROW = (
    b'{"task": "a", "stage": "FSH", "policy": "p", "prompt": "default", "seed": 0, "rollout": 0, '
    b'"success": true, "violation": false}'
)


def stored(tmp_path, outcomes, form="csv", name="table"):
    path = tmp_path / f"{name}.{form}"
    WRITERS[form](frame(outcomes), path)
    return path


def read(*paths):
    return read_outcomes(paths)[""]


@pytest.mark.parametrize("form", WRITERS)
def test_every_format_holds_the_same(tmp_path, form):
    outcomes = campaign(3, open_share=0.1)
    found = read(stored(tmp_path, outcomes, form))
    assert [replace(o, where="") for o in found] == outcomes
    assert found[4].where.endswith(f"table.{form}, row 5")


@pytest.mark.parametrize("truths", [("1", "0"), ("TRUE", "FALSE"), ("1.0", "0.0")])
def test_truths_as_others_write_them(tmp_path, truths):
    table = frame(campaign(3))
    for name in ("success", "violation"):
        table[name] = [truths[0] if value else truths[1] for value in table[name]]
    table.to_csv(tmp_path / "a.csv", index=False)
    wanted = [(o.success, o.violation) for o in campaign(3)]
    assert [(o.success, o.violation) for o in read(tmp_path / "a.csv")] == wanted


def test_truths_as_numbers_with_gaps(tmp_path):
    table = frame(campaign(3, open_share=0.2))
    table["violation"] = table["violation"].astype("float64")
    table["success"] = table["success"].astype("int8")
    table.to_parquet(tmp_path / "a.parquet")
    wanted = [(o.success, o.violation) for o in campaign(3, open_share=0.2)]
    assert [(o.success, o.violation) for o in read(tmp_path / "a.parquet")] == wanted


def test_a_rollout_that_is_there_twice_is_named(tmp_path):
    outcomes = campaign(3)
    path = stored(tmp_path, [*outcomes, replace(outcomes[6], success=not outcomes[6].success)])
    with pytest.raises(InputError) as error:
        read(path)
    assert f"row 7 and {path}, row {len(outcomes) + 1}" in str(error.value)
    with pytest.raises(InputError, match=f"{len(outcomes)} rollouts are there twice"):
        read(*[stored(tmp_path, outcomes)] * 2)


RESULT = {
    "episode_id": "e", "rule": "FSH101", "assigned": True, "verdict": "pass", "success": True,
    "task": "mug", "stage": "FSH", "policy": "act", "prompt": "default", "seed": 0, "rollout": 0,
}  # fmt: skip


def result(*changes):
    return outcomes_of([{**RESULT, **change} for change in changes])


@pytest.mark.parametrize(
    ("verdicts", "violation", "judged"),
    [
        (["pass", "not_applicable"], False, True),
        (["pass", "inconclusive"], None, True),
        (["inconclusive", "violation"], True, True),
        (["pass", None], False, True),
        ([None], None, False),
    ],
)
def test_an_episode_is_violated_if_any_assigned_rule_is(verdicts, violation, judged):
    found = result(*({"rule": f"R{i}", "verdict": v} for i, v in enumerate(verdicts)))
    assert [(o.violation, o.judged) for o in found] == [(violation, judged)]


def test_rules_that_are_not_assigned_decide_nothing():
    (found,) = result({}, {"rule": "ETS101", "assigned": False, "verdict": "violation"})
    assert (found.violation, found.judged) == (False, True)
    (found,) = result({"assigned": False})
    assert not found.judged


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"success": 2}, r"row 2: success is 2"),
        ({"violation": "maybe"}, r"row 2: violation is 'maybe'"),
        ({"stage": "XYZ"}, r"row 2: stage is 'XYZ'.*ISH, ETS, FSH"),
        ({"seed": None}, r"row 2: nothing is said of seed"),
        ({"task": ""}, r"row 2: nothing is said of task"),
    ],
)
def test_what_a_row_cannot_say(change, words):
    table = frame(campaign(3)[:2]).to_dict("records")
    with pytest.raises(InputError, match=words):
        outcomes_of([table[0], {**table[1], **change}])


def test_two_verdicts_of_a_rule_on_an_episode():
    with pytest.raises(InputError, match="row 2: a second verdict of FSH101"):
        result({}, {"verdict": "violation"})
    with pytest.raises(InputError, match="verdict is 'fine'"):
        result({"verdict": "fine"})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"", "is an empty file"),
        (b"\xff\xfe\x00", "not a table"),
        (b"PAR1 no", "a broken Parquet file"),
        (b"task,stage\na,FSH\n", "lacks policy, prompt, seed, rollout, success, violation"),
        (b'{"a": 1}\n{"b": 2}', "a table of something else: 'a'"),
        (b'{"task": 1}\n{"b": 2}', "row 1: lacks stage"),
        (ROW + b'\n{"b"', "line 2"),
        (b'{"a"', "line 1"),
        (b"[1, 2]", "no results"),
        (b"task,stage\na,FSH,x\n", "row 1: it has more cells than there are columns"),
        (b"3\n", "text, or a table of something else"),
    ],
)
def test_files_without_outcomes(tmp_path, text, words):
    path = tmp_path / "it"
    path.write_bytes(text)
    with pytest.raises(InputError, match=words):
        aggregate(read(path))


def test_a_label_tells_sets_apart(tmp_path):
    outcomes = campaign(3)
    table = pl.from_pandas(frame(outcomes))
    both = pl.concat([table.with_columns(rules=pl.lit(name)) for name in ("old", "new")])
    both.write_parquet(tmp_path / "both.parquet")
    found = read_outcomes([tmp_path / "both.parquet"], "rules")
    assert list(found) == ["old", "new"]
    assert [replace(o, where="") for o in found["new"]] == outcomes


def results(episodes, rules):
    """Rows of ``score``: the episodes turn about, so that no two rows of one stand together."""
    return [
        {
            "episode_id": f"e{e}", "rule": f"FSH{r}", "assigned": r == 0,
            "verdict": "violation" if r == 0 and e % 3 == 0 else "pass", "success": True,
            "task": f"t{e}", "stage": "FSH", "policy": "p", "prompt": "default", "seed": 0,
            "rollout": 0, "vacuity": None,
        }
        for r in range(rules)
        for e in range(episodes)
    ]  # fmt: skip


@pytest.mark.parametrize("form", ["parquet", "csv", "jsonl"])
def test_memory_grows_with_episodes_and_not_with_their_rows(tmp_path, form):
    def peak(rules):
        path = tmp_path / f"{rules}.{form}"
        table = pl.DataFrame(results(20, rules), infer_schema_length=None)
        {"parquet": table.write_parquet, "csv": table.write_csv, "jsonl": table.write_ndjson}[form](
            path
        )
        tracemalloc.start()
        try:
            found = read(path)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert [o.violation for o in found] == [e % 3 == 0 for e in range(20)]
        return most

    peak(2)  # loads libraries
    rows = 20 * 400
    assert peak(600) - peak(200) < 100 * rows  # a row as a dict takes about 1,000 bytes
