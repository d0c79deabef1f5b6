"""Two runs are compared: what flipped comes first, refused episodes count, rounding does not."""

import polars as pl
import pytest
import same_rows

ROW = {"episode_id": "a", "rule": "X", "verdict": "violation", "margin": -2.0,
       "explanation": "cup_1 fell by 3.1 cm.", "notes": [], "bodies": ["cup_1"]}  # fmt: skip
REFUSED = {**ROW, "rule": "refused", "verdict": "refused", "margin": None,
           "explanation": "/d/a.parquet: the clock runs back at 2.5 s."}  # fmt: skip


def compared(tmp_path, monkeypatch, capsys, old, new):
    """What is printed, and the exit code."""
    for name, rows in (("old", old), ("new", new)):
        pl.DataFrame(rows, schema_overrides={"margin": float}).write_parquet(tmp_path / name)
    monkeypatch.setattr("sys.argv", ["same_rows", str(tmp_path / "old"), str(tmp_path / "new")])
    code = same_rows.main()
    return capsys.readouterr().out, code


@pytest.mark.parametrize(
    ("new", "said", "code"),
    [
        (ROW, "0 other verdicts, 0 rows that differ otherwise", 0),
        ({**ROW, "margin": -2.0 - 1e-10}, "0 other verdicts, 0 rows", 0),
        ({**ROW, "margin": -2.1}, "margin: 1 rows of the same verdict\n      1 X", 1),
        ({**ROW, "explanation": "other words"}, "0 other verdicts, 0 rows", 0),
        ({**ROW, "verdict": "pass"}, "violation -> pass: 1\n      1 X", 1),
        ({**ROW, "verdict": "pass"}, "violation: · fell by # cm. | e.g. a", 1),
        (REFUSED, "violation -> refused: refused: the clock runs back at # s. | e.g. a", 1),
        ({**ROW, "rule": "Y"}, "violation -> absent", 1),
        ({**ROW, "verdict": None}, "violation -> none", 1),
    ],
)
def test_one_row(tmp_path, monkeypatch, capsys, new, said, code):
    out, got = compared(tmp_path, monkeypatch, capsys, [ROW], [new])
    assert said in out
    assert got == code


def test_a_refused_episode_counts_for_every_rule_of_the_other_side(tmp_path, monkeypatch, capsys):
    judged = [{**ROW, "rule": rule} for rule in "XYZ"]
    for old, new in (([REFUSED], judged), (judged, [REFUSED])):
        out, code = compared(tmp_path, monkeypatch, capsys, old, new)
        assert code == 1
        assert "3 other verdicts" in out
    for reason, code in (("/e/a.parquet: the clock runs back at 2.5 s.", 0), ("it is torn.", 1)):
        other = {**REFUSED, "explanation": reason}
        assert compared(tmp_path, monkeypatch, capsys, [REFUSED], [other])[1] == code
