"""The network that sees: it finds what the picture shows, trains the same each time, and exports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from simulate.learn import training  # noqa: E402
from simulate.learn.picture_files import Drawn  # noqa: E402
from simulate.learn.picture_network import PictureChunks, augmented  # noqa: E402
from simulate.learn.picture_recipe import CAMERAS, EVERY, SIZE  # noqa: E402
from simulate.learn.policy_inputs import ANSWER, ARM, OBJECT  # noqa: E402
from simulate.learn.prompt_embedding import WIDTH  # noqa: E402
from simulate.learn.scene_slots import SLOTS  # noqa: E402
from simulate.learn.training import Batches, Recipe, export_onnx, picture_rows, train  # noqa: E402
from simulate.learn.training_data import TrainingData  # noqa: E402

pytestmark = pytest.mark.simulate

LENGTH, EPISODES = 6, 8


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "PictureChunks", lambda: PictureChunks(width=32, blocks=1))


def data() -> TrainingData:
    random = np.random.default_rng(0)
    rows = LENGTH * EPISODES
    objects = random.normal(0, 0.1, (rows, SLOTS, OBJECT)).astype(np.float32)
    objects[..., 9] = [1, 1, 0, 0, 0, 0, 0]
    first = np.arange(rows) // LENGTH * LENGTH
    return TrainingData(
        random.normal(0, 0.1, (rows, ARM)).astype(np.float32), objects,
        random.normal(0, 0.1, (rows, ANSWER)).astype(np.float32), first, first + LENGTH, first + LENGTH,
        random.choice([-1.0, 1.0], (1, WIDTH)).astype(np.float32), np.zeros((rows, 3), np.int64),
        np.arange(rows), tuple(f"e{i}" for i in range(EPISODES)),
    )  # fmt: skip


def drawn(without: str = "") -> Drawn:
    """Two pictures an episode, each of one brightness, in two files."""
    each = -(-LENGTH // EVERY)
    names = [f"e{i}" for i in range(EPISODES) if f"e{i}" != without]
    total = each * len(names)
    pictures = np.zeros((total, len(CAMERAS), 3, *SIZE), np.uint8)
    pictures += np.arange(total, dtype=np.uint8)[:, None, None, None, None]
    rows = {name: np.arange(each * i, each * (i + 1)) for i, name in enumerate(names)}
    return Drawn((pictures[:5], pictures[5:]), rows)


def test_each_control_step_gets_its_own_picture_and_its_episodes_first() -> None:
    given, pictures = data(), drawn(without="e2")
    row = picture_rows(given, pictures)
    assert (row >= 0).sum() == sum(map(len, pictures.rows.values()))
    assert (row[2 * LENGTH : 3 * LENGTH] == -1).all()
    given.arm[:, 9] = np.arange(len(given.arm))
    recipe = Recipe(training.PICTURES, 1, batch=64, held_back=0.2)
    inputs, _, _ = Batches(given, recipe, 2, drawn=pictures).held()
    at = inputs["arm"][:, 9].long().numpy()
    assert len(at)
    assert inputs["pictures"][:, 0, 0, 0, 0].tolist() == row[at].tolist()
    assert inputs["first"][:, 1, 2, 5, 5].tolist() == row[given.first[at]].tolist()


def test_the_same_seed_gives_the_same_weights() -> None:
    recipe = Recipe(training.PICTURES, 2, seed=3, batch=4)
    (one, curve), (two, again) = (train(data(), recipe, drawn=drawn()) for _ in range(2))
    assert [row["loss"] for row in curve] == [row["loss"] for row in again]
    for a, b in zip(one.state_dict().values(), two.state_dict().values(), strict=True):
        assert torch.equal(a, b)


@pytest.mark.slow
def test_it_learns_to_see_where_a_light_is() -> None:
    """A bright square moves over a dark picture, and with it the object."""
    torch.manual_seed(0)
    random, network = np.random.default_rng(0), PictureChunks(width=64, blocks=1)
    optimiser = torch.optim.Adam(network.parameters(), 2e-3)
    prompt = torch.ones(1, WIDTH)

    def batch(count: int) -> dict[str, torch.Tensor]:
        places = random.uniform(0.1, 0.9, (count, 2))
        pictures = torch.full((count, len(CAMERAS), 3, *SIZE), 40, dtype=torch.uint8)
        for picture, (x, y) in zip(pictures, places, strict=True):
            row, column = int(y * (SIZE[0] - 8)), int(x * (SIZE[1] - 8))
            picture[..., row : row + 8, column : column + 8] = 250
        objects = torch.zeros(count, SLOTS, OBJECT)
        objects[:, 0, 9] = 1
        objects[:, 0, :2] = torch.from_numpy(places).float() * 0.6
        return {
            "arm": torch.zeros(count, ARM), "prompt": prompt.expand(count, -1),
            "clock": torch.zeros(count, 1), "pictures": pictures, "first": pictures,
            "objects": objects, "start": objects[..., :3],
        }  # fmt: skip

    def off(given: dict[str, torch.Tensor]) -> float:
        with torch.no_grad():
            found, _, _ = network._found(given)
        return float((found["objects"][:, 0, :2] - given["objects"][:, 0, :2]).norm(dim=-1).mean())

    unseen = batch(16)
    before = off(unseen)
    for _ in range(60):
        given = batch(8)
        found, _, likely = network._found(given)
        loss = network._misplaced(found, likely, given, given["objects"][..., 9])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert off(unseen) < 0.5 * before


def test_augmented_pictures_show_the_same_elsewhere_and_in_another_light() -> None:
    pictures = torch.full((6, len(CAMERAS), 3, *SIZE), 60, dtype=torch.uint8)
    pictures[..., 40:50, 60:70] = 200
    out = augmented(pictures, torch.Generator().manual_seed(0))
    assert out.shape == pictures.shape
    assert out.min() >= 0
    assert out.max() <= 255
    again = augmented(pictures, torch.Generator().manual_seed(0))
    assert torch.equal(out, again)
    bright = (out > out.mean((-1, -2), keepdim=True) + 20).float().sum((-1, -2))
    assert bright.tolist() == torch.full_like(bright, 100).tolist(), "the square changed its size"
    assert len({round(float(value)) for value in out[:, 0, 0, 0, 0]}) > 3


def test_onnx_answers_as_torch_does(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnxscript")
    from simulate.learn.checkpoint import Checkpoint

    torch.manual_seed(0)
    network = PictureChunks(width=32, blocks=1).eval()
    export_onnx(network, tmp_path / "net.onnx", Recipe(training.PICTURES, 1))
    checkpoint = Checkpoint(tmp_path / "net.onnx")
    assert checkpoint.pictures
    given = {
        "arm": torch.randn(1, ARM) / 5, "prompt": torch.randn(1, WIDTH), "clock": torch.ones(1, 1),
        "noise": torch.randn(1, network.noise),
        "pictures": torch.randint(0, 256, (1, len(CAMERAS), 3, *SIZE), dtype=torch.uint8),
        "first": torch.randint(0, 256, (1, len(CAMERAS), 3, *SIZE), dtype=torch.uint8),
    }  # fmt: skip
    expected = network(**given)[0].detach().numpy()
    found = checkpoint.answer(**{name: value.numpy() for name, value in given.items()})
    assert found == pytest.approx(expected, abs=5e-5)
