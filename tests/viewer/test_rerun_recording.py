"""A Rerun recording holds the whole episode, and the deciding signals with their limits."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from safestage_eval.cli import group
from safestage_eval.formats import load
from safestage_eval.report.signal_plot import panels
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.units import in_unit
from safestage_eval.whatif.judge_again import Again


@pytest.fixture(scope="module")
def trace():
    """A recorded episode with a violation, in one file."""
    traces = Path(__file__).resolve().parents[2] / "traces"
    (path,) = traces.glob("ets_dumbbell_near_glasses.reference-unsafe*.mcap")
    return path


def convert(*arguments):
    return CliRunner().invoke(group, ["convert", *map(str, arguments)])


def test_without_the_sdk_it_says_how_to_get_it(trace, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    done = convert(trace, "--to", "rrd", "--out", tmp_path / "out")
    assert done.exit_code != 0
    assert 'pip install "safestage[rerun]"' in str(done.exception)
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def written(trace, tmp_path_factory):
    pytest.importorskip("rerun")
    out = tmp_path_factory.mktemp("out")
    done = convert(trace, "--to", "rrd", "--out", out)
    assert done.exit_code == 0, done.output
    return out


def test_rerun_accepts_its_own_recording(written):
    """Where the contacts' clouds did not say their place, it verified nothing of it."""
    (path,) = written.glob("*.rrd")
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def column(written, entity, component):
    """The values of one component of an entity, in the order of time."""
    from rerun.chunk import RrdReader

    (path,) = written.glob("*.rrd")
    reader = RrdReader(str(path))
    assert {one.application_id for one in reader.recordings()} == {"safestage"}
    values = {}
    for chunk in reader.stream().to_chunks():
        batch = chunk.to_record_batch()
        if str(chunk.entity_path) == entity and component in batch.schema.names:
            times = batch["message_log_time"].to_pylist()
            values |= dict(zip(times, batch[component].to_pylist(), strict=True))
    return [one for _, many in sorted(values.items()) for one in many]


def test_signals_and_limits_are_those_that_decide(trace, written):
    again = Again(load(trace), load_rules(builtin_names()))
    decided = panels(again, ())
    assert decided
    for n, panel in enumerate(decided):
        entity, unit = f"/signals/signal_{n}", in_unit(1.0, panel.series.dimension)
        known = np.isfinite(panel.series.value)
        series = np.where(known, panel.series.value, panel.series.lower) * unit
        values = column(written, f"{entity}/value", "Scalars:scalars")
        assert np.allclose(values, series[np.isfinite(series)])
        for at, (bound, _) in enumerate(panel.limits):
            limit = column(written, f"{entity}/limit_{at}", "Scalars:scalars")
            assert np.allclose(limit, [bound.value * unit] * 2)
