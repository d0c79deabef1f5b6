"""LeRobot datasets: what is written is what was recorded, in the layout that LeRobot reads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from safestage_eval.errors import InputError
from safestage_eval.formats import discover
from simulate.learn.control_steps import control_steps
from simulate.learn.lerobot_writer import ACTION, DISTURBED, SCENE, STATE, export

TRACES = Path(__file__).parents[3] / "traces"


@pytest.fixture(scope="module")
def episodes():
    refs = [ref for ref in discover([TRACES]) if "reference" in (ref.episode_id or "")]
    return [ref.open() for ref in refs[:3]]


@pytest.fixture(scope="module")
def dataset(episodes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lerobot") / "dataset"
    export(zip(episodes, (False, True, None), strict=True), folder)
    return folder


def test_every_row_comes_back(dataset: Path, episodes) -> None:
    meta = pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    data = pq.read_table(dataset / "data/chunk-000/file-000.parquet")
    for row, episode in zip(meta, episodes, strict=True):
        steps = control_steps(episode)
        part = data.slice(row["dataset_from_index"], row["length"])
        assert row["dataset_to_index"] - row["dataset_from_index"] == row["length"] == len(steps)
        for name, values in ((STATE, steps.state), (SCENE, steps.scene), (ACTION, steps.action)):
            assert np.array_equal(np.array(part[name].to_pylist(), np.float32), values)
        assert part[DISTURBED].to_pylist() == steps.disturbed.tolist()
        assert set(part["episode_index"].to_pylist()) == {row["episode_index"]}
        assert part["frame_index"].to_pylist() == list(range(len(steps)))
        assert row["tasks"] == [episode.header.instruction]
        assert row["safestage.episode_id"] == episode.header.episode_id
    assert [row["safestage.violation"] for row in meta] == [False, True, None]
    assert data["index"].to_pylist() == list(range(len(data)))


def test_info_describes_the_columns(dataset: Path) -> None:
    info = json.loads((dataset / "meta/info.json").read_text())
    schema = pq.read_schema(dataset / "data/chunk-000/file-000.parquet")
    assert set(info["features"]) == set(schema.names)
    for name, feature in info["features"].items():
        kind = schema.field(name).type
        (width,) = feature["shape"]
        if width > 1:
            assert kind.list_size == width == len(feature["names"])
            kind = kind.value_type
        assert str(kind) == {"float32": "float", "bool": "bool", "int64": "int64"}[feature["dtype"]]
    assert info["total_episodes"] == 3
    assert info["fps"] == 15


def test_a_folder_in_use_and_nothing_to_write_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="without an episode"):
        export([], tmp_path / "none")
    (tmp_path / "x").write_text("")
    with pytest.raises(InputError, match="not empty"):
        export([], tmp_path)
