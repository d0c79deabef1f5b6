"""The schema of results is up to date, accepts what is printed, and refuses what is not."""

import copy
import json
from pathlib import Path

import jsonschema
import pytest

from safestage_eval.report import render
from safestage_eval.report.result_rows import COLUMNS
from safestage_eval.report.result_schema import FILE, results_schema, schema_text
from safestage_eval.run.score_traces import score_paths

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def printed():
    return json.loads(render(score_paths([ROOT / "traces"], [ROOT / "rules"], jobs=1), "json"))


def test_the_committed_file_is_what_the_code_says():
    assert (ROOT / "schemas" / FILE).read_text("utf-8") == schema_text()


def test_what_is_printed_is_accepted(printed):
    jsonschema.validate(printed, results_schema())


@pytest.mark.parametrize("column", COLUMNS)
def test_a_row_without_a_column_is_refused(printed, column):
    broken = copy.deepcopy(printed)
    del broken["episodes"][0][column]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, results_schema())


def test_an_unknown_verdict_is_refused(printed):
    broken = copy.deepcopy(printed)
    broken["episodes"][0]["verdict"] = "fine"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, results_schema())
