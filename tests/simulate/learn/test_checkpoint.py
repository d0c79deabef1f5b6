"""The shipped checkpoint loads, says what it is, and is small; other files are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safestage_eval.errors import InputError
from simulate.learn.checkpoint import FOLDER, Checkpoint, checkpoint_file, opened, shipped
from simulate.learn.policy_inputs import ANSWER, ARM, OBJECT
from simulate.learn.prompt_embedding import WIDTH
from simulate.learn.scene_slots import SLOTS

pytest.importorskip("onnxruntime")
pytestmark = pytest.mark.simulate


def test_one_is_shipped_with_its_curve_and_is_small() -> None:
    assert "act" in shipped()
    for name in shipped():
        assert checkpoint_file(name).stat().st_size <= 10e6
        assert b".py" not in checkpoint_file(name).read_bytes(), (
            "it tells whose folders it was made in"
        )
        assert (FOLDER / f"{name}.csv").is_file()


@pytest.mark.parametrize("name", shipped())
def test_a_checkpoint_answers(name: str) -> None:
    checkpoint = opened(name)
    assert checkpoint.about["kind"] == name
    zeros = {
        "arm": np.zeros((1, ARM), np.float32),
        "objects": np.zeros((1, SLOTS, OBJECT), np.float32),
        "start": np.zeros((1, SLOTS, 3), np.float32),
        "prompt": np.zeros((1, WIDTH), np.float32),
        "clock": np.zeros((1, 1), np.float32),
        "noise": np.zeros((1, max(checkpoint.noise, 1)), np.float32),
    }
    answer = checkpoint.answer(**zeros)
    assert answer.shape == (checkpoint.about["chunk"], ANSWER)
    assert 1 <= checkpoint.play <= len(answer)
    assert np.array_equal(checkpoint.answer(**zeros), answer)


def test_what_is_no_checkpoint_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"Allowed: act.*the path of an .onnx file"):
        opened("best")
    (tmp_path / "x.onnx").write_bytes(b"no network")
    with pytest.raises(InputError, match="learn train"):
        Checkpoint(tmp_path / "x.onnx")
