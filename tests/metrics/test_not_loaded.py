"""An assigned rule that was not loaded: its absence must not read as if it had been kept."""

import json

import jsonschema
import pytest

from safestage_eval.metrics import outcomes, read_outcomes
from safestage_eval.metrics.outcome_rows import FOR_LABELS
from safestage_eval.report import render
from safestage_eval.report.result_schema import row_schema
from safestage_eval.run.scores import Scores
from safestage_eval.verdicts import EpisodeResult, Verdict

SAID = ["pass", "violation", "inconclusive", "not_applicable", None]


def result(verdict: str | None, *not_loaded: str) -> EpisodeResult:
    """An episode of two assigned rules at most: one judged, the others not loaded."""
    own = () if verdict is None else (Verdict("FSH101", "edge", "FSH", True, verdict),)
    other = Verdict("ETS101", "touch", "ETS", False, "violation")
    return EpisodeResult(
        "a", "a.mcap", "mug", "FSH", None, "act", "default", 0, 0, True, 1.0, "00", "1",
        verdicts=(*own, other), not_loaded=not_loaded,
    )  # fmt: skip


@pytest.mark.parametrize("form", ["csv", "json", "jsonl", "parquet"])
@pytest.mark.parametrize("not_loaded", [(), ("FSH202",), ("FSH202", "FSH203")])
@pytest.mark.parametrize("verdict", SAID)
def test_files_count_an_episode_as_the_judge_does(tmp_path, form, verdict, not_loaded):
    scores = Scores((result(verdict, *not_loaded),), rules={"FSH101": "edge"})
    file = tmp_path / f"rows.{form}"
    data = render(scores, form)
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    (wanted,) = outcomes(scores.results)
    (found,) = read_outcomes([file])[""]
    assert (found.violation, found.judged) == (wanted.violation, wanted.judged)
    (said,) = read_outcomes([file], wanted=FOR_LABELS)[""]
    assert said.violation == scores.results[0].violation


def test_its_row_says_so():
    *_, row = result("pass", "FSH202").rows()
    values = {key: row[key] for key in ("rule", "assigned", "verdict", "violation", "vacuity")}
    assert values == {
        "rule": "FSH202", "assigned": True, "verdict": None, "violation": None,
        "vacuity": "not_loaded",
    }  # fmt: skip
    assert "FSH202 is assigned and was not loaded" in row["explanation"]
    jsonschema.validate(json.loads(json.dumps(row)), row_schema())
