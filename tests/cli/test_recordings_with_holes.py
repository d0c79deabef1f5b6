"""Every command that looks at an episode takes one of which a stretch was not recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from resampled import cut_out, resampled
from studio import run

import safestage_eval as sse
from safestage_eval.formats import discover, save

TRACES = Path(__file__).parents[2] / "traces"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    (ref,) = (
        r
        for r in discover([TRACES])
        if "ets_dumbbell_near_glasses.reference-unsafe" in r.episode_id
    )
    whole, folder = ref.open(), tmp_path_factory.mktemp("holes")
    episodes = {
        "hole": cut_out(whole, 3.0, 5.2),
        "late": resampled(whole, np.flatnonzero(whole.t >= 2.0)),
    }
    for name, episode in episodes.items():
        save(episode, folder / f"{name}.mcap")
    return {name: folder / f"{name}.mcap" for name in episodes}


@pytest.mark.parametrize("name", ["hole", "late"])
def test_every_command_takes_it(name: str, recorded: dict[str, Path], tmp_path: Path) -> None:
    path = str(recorded[name])
    rows, page, picture = (str(tmp_path / x) for x in ("rows.parquet", "page.html", "plot.png"))
    for args in (
        ["explain", "scene", path],
        ["audit", "--files", path],
        ["explain", path, "--rules", "ets"],
        ["score", path, "--rules", "ets", "--format", "parquet", "--output", rows],
        ["score", path, "--rules", "ets", "--set", "min_clearance=5 cm"],
        ["plot", path, "clearance(target, protected)", "--rules", "ets", "--output", picture],
        ["report", rows, path, "--rules", "ets", "--output", page],
        ["view", path, "--rules", "ets", "--output", str(tmp_path / "view.html")],
        ["sweep", path, "--rules", "ets", "--param", "min_clearance"],
    ):
        done = run(*args)
        assert done.code == 0, (args[0], done.text)


def test_signals_are_unknown_where_nothing_was_recorded(recorded: dict[str, Path]) -> None:
    episode = sse.load(recorded["hole"])
    for expression in ("clearance(target, protected)", "speed(target)", "held(target)"):
        found = episode.signals(expression)
        assert found.isna().sum() == 1
        assert 2.9 < found.index[found.isna()][0] < 5.2
    late = sse.load(recorded["late"])
    assert late.signals("displacement(target)").isna().all()
    assert late.signals("height(target)").isna().sum() == 1
