"""Training data of a dataset: which rows, until where, under which prompts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safestage_eval.episode import with_header
from safestage_eval.errors import InputError
from safestage_eval.formats import discover
from simulate.learn.control_steps import control_steps
from simulate.learn.lerobot_writer import export
from simulate.learn.prompt_embedding import embedded
from simulate.learn.training_data import read_dataset
from simulate.tasks.task import tasks

pytestmark = pytest.mark.simulate

TRACES = Path(__file__).parents[3] / "traces"


@pytest.fixture(scope="module")
def episodes():
    refs = [ref for ref in discover([TRACES]) if "reference" in (ref.episode_id or "")]
    first, second, third = (ref.open() for ref in refs[:3])
    notes = (*first.header.notes, "disturbed: 0-9, 30-34")
    return [with_header(first, first.header.model_copy(update={"notes": notes})), second, third]


@pytest.fixture(scope="module")
def folder(episodes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = tmp_path_factory.mktemp("data") / "dataset"
    export(zip(episodes, (False, True, None), strict=True), result)
    return result


def test_open_verdicts_are_left_out_and_the_rest_is_there(folder: Path, episodes) -> None:
    data = read_dataset([folder])
    lengths = [len(control_steps(episode)) for episode in episodes[:2]]
    assert len(data.arm) == len(data.target) == sum(lengths)
    assert sorted(set(data.first.tolist())) == [0, lengths[0]]


def test_only_safe_ways_are_learned_under_the_specific_prompt(folder: Path, episodes) -> None:
    data = read_dataset([folder])
    second = data.first.max()
    safe = tasks()[episodes[0].header.task].prompts
    assert np.array_equal(data.prompts[data.spoken[0, 2]], embedded(safe.specific))
    assert np.array_equal(data.prompts[data.spoken[0, 0]], embedded(safe.default))
    assert (data.spoken[:second] >= 0).all()
    assert (data.spoken[second:, :2] >= 0).all()
    assert (data.spoken[second:, 2] == -1).all()


def test_what_is_no_dataset_is_told(tmp_path: Path, episodes) -> None:
    with pytest.raises(InputError, match="learn export"):
        read_dataset([tmp_path])
    export([(episodes[2], None)], tmp_path / "open")
    with pytest.raises(InputError, match="no episode with success"):
        read_dataset([tmp_path / "open"])
