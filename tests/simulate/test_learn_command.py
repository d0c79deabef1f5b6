"""``safestage bench learn``: what it writes, what it says, and what it refuses."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from studio import run

from safestage_eval.formats import discover, save

pytestmark = pytest.mark.simulate

TRACES = Path(__file__).parents[2] / "traces"


def test_export_writes_success_and_verdict_and_leaves_failures_out(tmp_path: Path) -> None:
    refs = [ref for ref in discover([TRACES]) if "reference-unsafe" in (ref.episode_id or "")]
    save(refs[0].open(), tmp_path / "traces", "parquet", ())
    out = tmp_path / "dataset"
    export = ("bench", "learn", "export", tmp_path / "traces", "--out", out)
    done = run(*export)
    assert done.code == 0, done.err
    assert "1 episodes" in done.text + done.err
    (row,) = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert row["safestage.success"] is True
    assert row["safestage.violation"] is True
    again = run(*export)
    assert again.code == 2
    assert "not empty" in again.err


@pytest.mark.skipif(importlib.util.find_spec("torch") is not None, reason="PyTorch is here")
def test_training_without_torch_says_what_to_install(tmp_path: Path) -> None:
    done = run("bench", "learn", "train", "bc", "--data", tmp_path, "--out", tmp_path / "x.onnx")
    assert done.code == 2
    assert "safestage[learn]" in done.err
