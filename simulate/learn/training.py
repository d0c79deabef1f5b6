"""Trains a network on demonstrations, the same for the same seed, and exports it to ONNX."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from safestage_eval.version import __version__
from simulate.world.world import CONTROL_RATE

from .checkpoint import ABOUT, INPUTS
from .networks import Network, made
from .policy_inputs import ARM, OBJECT
from .prompt_embedding import WIDTH
from .scene_slots import SLOTS
from .training_data import TrainingData

NUDGE = (0.01, 0.002)
"""m, standard deviation by which the TCP is moved in the inputs, with the gripper open and closed; what is to
be answered stays where it is, so this shows how to come back."""
OPEN = 0.85
"""Opening from which on nothing is held."""
SAFE_SHARE = 0.6
"""Share of safe ways in a batch; a third of these under the specific prompt, so that the others see as many safe as unsafe ways."""


STEPS = {"bc": 10_000, "act": 14_000, "diffusion": 14_000}
"""Steps of the recipe. Ten thousand took 190 to 250 s of processor each beside five others on one GPU, and 15 to 21
minutes on one thread."""


@dataclass(frozen=True)
class Recipe:
    """All that a checkpoint follows from, besides the data."""

    kind: str
    steps: int
    seed: int = 0
    batch: int = 1024
    rate: float = 1e-3
    held_back: float = 0.03
    """Share of the episodes that only measures."""


class Batches:
    """Random batches of control steps, on the processor or on a GPU."""

    def __init__(
        self,
        data: TrainingData,
        recipe: Recipe,
        chunk: int,
        device: torch.device | str = "cpu",
    ) -> None:
        """Hold some episodes back; of the others batches are drawn."""
        self._device = torch.device(device)
        usable = data.usable
        self._arm, self._objects, self._target, self._prompts = (
            torch.from_numpy(rows).to(self._device)
            for rows in (data.arm, data.objects, data.target, data.prompts)
        )
        self._first, self._until, self._end, self._spoken = (
            torch.from_numpy(rows).to(self._device)
            for rows in (data.first, data.until, data.end, data.spoken)
        )
        self._ahead = torch.arange(chunk, device=self._device)
        self._random = torch.Generator(self._device).manual_seed(recipe.seed)
        random = np.random.default_rng(recipe.seed)
        episodes = np.unique(data.first[usable])
        count = max(1, round(recipe.held_back * len(episodes)))
        back = np.isin(data.first[usable], random.choice(episodes, count, replace=False))
        train = usable[~back]
        safe = data.spoken[train, 2] >= 0
        self._safe, self._unsafe, self._held = (
            torch.from_numpy(rows).to(self._device)
            for rows in (train[safe], train[~safe], usable[back])
        )
        self._batch = recipe.batch

    def draw(self) -> tuple[dict[str, Tensor], Tensor, Tensor]:
        """Inputs, targets from the TCP, and which of these are known."""
        safe = round(SAFE_SHARE * self._batch) if len(self._unsafe) else self._batch
        safe = safe if len(self._safe) else 0
        rows = torch.cat(
            [
                kind[self._integers(len(kind), count)]
                for kind, count in ((self._safe, safe), (self._unsafe, self._batch - safe))
                if count
            ]
        )
        return self._of(rows, nudge=True)

    def held(self, most: int = 2048) -> tuple[dict[str, Tensor], Tensor, Tensor]:
        """Control steps of episodes that are never trained on."""
        return self._of(self._held[:: max(1, len(self._held) // most)], nudge=False)

    def _integers(self, below: int, count: int) -> Tensor:
        return torch.randint(below, (count,), generator=self._random, device=self._device)

    def _of(self, rows: Tensor, *, nudge: bool) -> tuple[dict[str, Tensor], Tensor, Tensor]:
        count = len(rows)
        spoken, until = self._spoken[rows], self._until[rows][:, None]
        conditions = 2 + (spoken[:, 2] >= 0).long()
        condition = self._integers(6, count) % conditions  # 6 is a multiple of 2 and of 3
        arm, clock = self._arm[rows].clone(), (rows - self._first[rows])[:, None] / CONTROL_RATE
        if nudge:
            size = torch.where(arm[:, 9:] > OPEN, *NUDGE)
            arm[:, :3] += size * torch.randn(
                (count, 3), generator=self._random, device=self._device
            )
        ahead = rows[:, None] + self._ahead
        known = (ahead < until) | (until == self._end[rows][:, None])
        target = self._target[torch.minimum(ahead, until - 1)].clone()
        target[..., :3] -= arm[:, None, :3]
        inputs = {
            "arm": arm,
            "objects": self._objects[rows],
            "start": self._objects[self._first[rows], :, :3],
            "prompt": self._prompts[spoken[torch.arange(count, device=self._device), condition]],
            "clock": clock,
        }
        return inputs, target, known.float()


def train(
    data: TrainingData,
    recipe: Recipe,
    tell: Callable[[dict[str, float]], None] = lambda _: None,
    device: torch.device | str = "cpu",
) -> tuple[Network, list[dict[str, float]]]:
    """A trained network, and its curve: losses in training and on episodes held back.

    ``tell`` hears of each row of the curve as it comes.
    """
    torch.manual_seed(recipe.seed)
    network = made(recipe.kind).to(device)
    batches = Batches(data, recipe, network.chunk, device)
    optimiser = torch.optim.AdamW(network.parameters(), recipe.rate, weight_decay=1e-4)
    rate = torch.optim.lr_scheduler.OneCycleLR(
        optimiser,
        recipe.rate,
        total_steps=recipe.steps,
        pct_start=max(0.05, min(0.75, 1.5 / recipe.steps)),
    )
    averaged = torch.optim.swa_utils.AveragedModel(
        network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.995)
    )
    curve, running, began = [], torch.zeros((), device=device), time.process_time()
    every = max(1, recipe.steps // 40)
    for step in range(1, recipe.steps + 1):
        loss = network.loss(*batches.draw())
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        rate.step()
        averaged.update_parameters(network)
        running += loss.detach() / every
        if step % every == 0:
            row = {"step": step, "loss": float(running), **measured(averaged.module, batches)}
            row["processor_s"] = time.process_time() - began
            curve.append({name: round(value, 5) for name, value in row.items()})
            tell(curve[-1])
            running.zero_()
    result: Network = averaged.module.cpu()
    return result.eval(), curve


def measured(network: Network, batches: Batches) -> dict[str, float]:
    """Errors of the network on episodes held back: mean distance (mm), and gripper right (share)."""
    inputs, target, mask = batches.held()
    with torch.no_grad():
        noise = torch.zeros(len(mask), max(network.noise, 1), device=mask.device)
        answer = network.eval().answer(inputs, noise)
    network.train()
    off = (answer[..., :3] - target[..., :3]).norm(dim=-1)
    right = ((answer[..., 9] > 0) == (target[..., 9] > 0)).float()
    return {
        "held_back_mm": float((off * mask).sum() / mask.sum()) * 1e3,
        "held_back_grip": float((right * mask).sum() / mask.sum()),
    }


def export_onnx(
    network: Network, path: Path, recipe: Recipe, more: dict[str, Any] | None = None
) -> None:
    """Write what acts, with all that acting needs to know, as one ONNX file."""
    import onnx

    examples = {
        "arm": torch.zeros(1, ARM), "objects": torch.zeros(1, SLOTS, OBJECT), "start": torch.zeros(1, SLOTS, 3),
        "prompt": torch.zeros(1, WIDTH), "clock": torch.zeros(1, 1), "noise": torch.zeros(1, max(network.noise, 1)),
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch's exporter warns of its own parts
        torch.onnx.export(
            network.eval(), tuple(examples[name] for name in INPUTS), str(path),
            input_names=list(INPUTS), output_names=["answer"],
            dynamo=True, external_data=False, verbose=False,
        )  # fmt: skip
    model = onnx.load(str(path))
    for part in (*model.graph.node, *model.graph.value_info, *model.graph.initializer):
        part.ClearField("metadata_props")  # where in whose folders each operation was written
        part.ClearField("doc_string")
    about = {
        "kind": recipe.kind, "chunk": network.chunk, "play": network.play, "noise": network.noise,
        "recipe": asdict(recipe), "safestage": __version__, "torch": torch.__version__, **(more or {}),
    }  # fmt: skip
    onnx.helper.set_model_props(model, {ABOUT: json.dumps(about)})
    onnx.save(model, str(path))
