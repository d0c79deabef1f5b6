"""Networks: shapes, laws of their anchors, the same seed the same weights, ONNX the same answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from simulate.learn.networks import KINDS, made  # noqa: E402
from simulate.learn.policy_inputs import ANSWER, ARM, OBJECT  # noqa: E402
from simulate.learn.prompt_embedding import WIDTH  # noqa: E402
from simulate.learn.scene_slots import SLOTS  # noqa: E402
from simulate.learn.training import Batches, Recipe, export_onnx, train  # noqa: E402
from simulate.learn.training_data import TrainingData  # noqa: E402

pytestmark = pytest.mark.simulate

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


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_not_known_costs_nothing(kind: str) -> None:
    network = made(kind, **SMALL).eval()
    given, target = inputs(), torch.randn(3, network.chunk, ANSWER)
    mask = torch.ones(3, network.chunk)
    mask[0] = 0

    def loss(targets: torch.Tensor) -> float:
        torch.manual_seed(1)
        return float(network.loss(given, targets, mask).detach())

    other = target.clone()
    other[0] += 1
    assert loss(other) == pytest.approx(loss(target), rel=1e-6)
    other[1] += 1
    assert loss(other) != pytest.approx(loss(target), rel=1e-6)


def test_an_empty_slot_is_no_anchor() -> None:
    network = made("bc", **SMALL).eval()
    with torch.no_grad():
        network.head.last.weight.zero_()
        network.head.last.bias.zero_()
    given = inputs()
    answer = network(**given, noise=torch.zeros(3, 1))
    there = torch.cat(
        [given["arm"][:, None, :3], given["objects"][:, :3, :3], given["start"][:, :1]], 1
    )
    assert torch.allclose(answer[:, 0, :3], there.mean(1), atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
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


@pytest.mark.parametrize("steps", [1, 2, 20, 21])
def test_any_number_of_steps_trains(steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The learning rate rises over 5 % of them: of 20, that is one."""
    monkeypatch.setattr("simulate.learn.training.made", lambda kind: made(kind, **SMALL))
    _, curve = train(data(), Recipe("bc", steps, batch=8))
    assert np.isfinite([row["loss"] for row in curve]).all()


def test_it_learns_where_to_go_by_the_prompt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simulate.learn.training.made", lambda kind: made(kind, **SMALL))
    _, curve = train(data(), Recipe("bc", 300, batch=64, rate=3e-3, held_back=0.1))
    assert curve[-1]["held_back_mm"] < 0.3 * curve[0]["held_back_mm"]
    assert curve[-1]["held_back_grip"] > 0.95


def test_held_back_episodes_are_never_drawn() -> None:
    given = data()
    given.arm[:, 9] = given.first
    batches = Batches(given, Recipe("bc", 1, batch=64, held_back=0.2), chunk=1)
    held = set(batches.held()[0]["arm"][:, 9].tolist())
    assert held
    for _ in range(50):
        assert not held & set(batches.draw()[0]["arm"][:, 9].tolist())


def test_a_nudge_moves_the_arm_and_not_where_it_shall_go() -> None:
    given = data()
    given.arm[:, 9] = 1.0
    inputs_, target, _ = Batches(given, Recipe("bc", 1, batch=64), chunk=1).draw()
    aim = inputs_["arm"][:, :3] + target[:, 0, :3]
    assert nearest(aim, given.target) < 1e-3
    assert nearest(inputs_["arm"][:, :3], given.arm) > 5e-3


def test_after_the_end_the_last_command_is_held_and_after_a_push_nothing_is_known() -> None:
    given = data(20)  # two episodes of ten control steps
    given.until[10:15] = 15  # the second one is pushed at its sixth
    given.arm[:, 9] = np.arange(20)
    batches = Batches(given, Recipe("act", 1, batch=64, held_back=0.0), chunk=6)
    batches._held = torch.arange(20)
    inputs_, target, known = batches.held(20)
    aim = inputs_["arm"][:, None, :3] + target[..., :3]
    assert known[7].all()
    assert known[16].all()
    assert torch.allclose(aim[7, 3:], torch.from_numpy(given.target[9, :3]), atol=1e-6)
    assert known[12].tolist() == [1, 1, 1, 0, 0, 0]


def nearest(places: torch.Tensor, rows: np.ndarray) -> float:
    """m, mean distance of places (B, 3) from the nearest of some rows."""
    off = places[:, None] - torch.from_numpy(rows[None, :, :3])
    return float(off.norm(dim=-1).min(1).values.mean())


@pytest.mark.parametrize("kind", KINDS)
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
