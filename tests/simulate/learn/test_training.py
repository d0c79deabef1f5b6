"""Networks: shapes, laws of their anchors, the same seed the same weights, ONNX the same answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sampled import share

torch = pytest.importorskip("torch")

from simulate.learn.networks import KINDS, made  # noqa: E402
from simulate.learn.policy_inputs import ANSWER, ARM, OBJECT  # noqa: E402
from simulate.learn.prompt_embedding import WIDTH  # noqa: E402
from simulate.learn.scene_slots import SLOTS  # noqa: E402
from simulate.learn.training import Recipe, export_onnx, train  # noqa: E402
from simulate.learn.training_data import TrainingData  # noqa: E402

pytestmark = pytest.mark.simulate

torch.set_num_threads(1)  # small networks: more threads wait for one another
SMALL = {"width": 32, "blocks": 1}


def inputs(count: int = 3, seed: int = 0) -> dict[str, torch.Tensor]:
    torch.manual_seed(seed)
    objects = torch.randn(count, SLOTS, OBJECT) / 5
    objects[..., 9] = torch.tensor([1.0, 1, 1, 0, 0, 0, 0])
    return {
        "arm": torch.randn(count, ARM) / 5,
        "objects": objects,
        "start": objects[..., :3] + 0.01,
        "prompt": torch.randn(count, WIDTH),
        "clock": torch.rand(count, 1) * 20,
    }


def data(rows: int = 400) -> TrainingData:
    """The TCP shall go to the first object under one prompt, and to the second under the other."""
    random = np.random.default_rng(0)
    arm = random.normal(0, 0.2, (rows, ARM)).astype(np.float32)
    objects = random.normal(0, 0.2, (rows, SLOTS, OBJECT)).astype(np.float32)
    objects[..., 9] = [1, 1, 0, 0, 0, 0, 0]
    target = arm.copy()
    half = np.arange(rows) < rows // 2
    target[:, :3] = np.where(half[:, None], objects[:, 0, :3], objects[:, 1, :3])
    target[:, 9] = np.where(half, 1, -1)
    spoken = np.where(half[:, None], [0, 0, 0], [1, 1, -1])
    first = np.arange(rows) // 10 * 10
    prompts = random.choice([-1.0, 1.0], (2, WIDTH)).astype(np.float32)
    return TrainingData(
        arm, objects, target, first, first + 10, first + 10, prompts, spoken, np.arange(rows)
    )


@pytest.mark.parametrize("kind", KINDS)
def test_an_answer_for_every_step_and_a_loss_that_is_a_number(kind: str) -> None:
    network = made(kind, **SMALL).eval()
    given = inputs()
    noise = torch.randn(3, max(network.noise, 1))
    answer = network(**given, noise=noise)
    assert answer.shape == (3, network.chunk, ANSWER)
    assert torch.isfinite(answer).all()
    assert 1 <= network.play <= network.chunk
    mask = torch.ones(3, network.chunk)
    assert network.loss(given, answer.detach(), mask).ndim == 0


@pytest.mark.parametrize("kind", share(KINDS, 3, of="seed"))
def test_the_same_seed_gives_the_same_weights(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simulate.learn.training.made", lambda kind: made(kind, **SMALL))
    recipe = Recipe(kind, 4, seed=3, batch=8)
    (one, curve), (two, again) = (train(data(), recipe) for _ in range(2))
    assert [row["loss"] for row in curve] == [row["loss"] for row in again]
    for a, b in zip(one.state_dict().values(), two.state_dict().values(), strict=True):
        assert torch.equal(a, b)
    other, _ = train(data(), Recipe(kind, 4, seed=4, batch=8))
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    assert not all(torch.equal(a, b) for a, b in pairs)


def nearest(places: torch.Tensor, rows: np.ndarray) -> float:
    """m, mean distance of places (B, 3) from the nearest of some rows."""
    off = places[:, None] - torch.from_numpy(rows[None, :, :3])
    return float(off.norm(dim=-1).min(1).values.mean())


@pytest.mark.parametrize("kind", share(KINDS, 3, of="onnx"))
def test_onnx_answers_as_torch_does(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnxscript")
    from simulate.learn.checkpoint import Checkpoint

    torch.manual_seed(0)
    network = made(kind, **SMALL).eval()
    export_onnx(network, tmp_path / "net.onnx", Recipe(kind, 1, seed=5))
    assert b"networks.py" not in (tmp_path / "net.onnx").read_bytes(), "it tells folders"
    checkpoint = Checkpoint(tmp_path / "net.onnx")
    assert checkpoint.about["recipe"]["seed"] == 5
    assert (checkpoint.play, checkpoint.noise) == (network.play, network.noise)
    given = inputs(1, seed=2)
    noise = torch.randn(1, max(network.noise, 1))
    expected = network(**given, noise=noise)[0].detach().numpy()
    arrays = {name: value.numpy() for name, value in {**given, "noise": noise}.items()}
    assert checkpoint.answer(**arrays) == pytest.approx(expected, abs=2e-5)
