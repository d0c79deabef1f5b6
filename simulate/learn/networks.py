"""The networks: behaviour cloning, action chunks (ACT) and diffusion, on one trunk and one head.

Needs PyTorch. A network's inputs are ``policy_inputs``' rows and a vector of noise; ``forward`` is what is
exported and acts, ``loss`` is what is trained.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 - the usual name

from .policy_inputs import ANSWER, ARM, OBJECT
from .prompt_embedding import WIDTH
from .scene_slots import SLOTS

FINE = 0.04
"""m: differences in place are seen a second time through tanh(difference / FINE), which tells millimetres."""
STEP_UNIT = 0.1
"""m, unit of what the head adds to its anchors, and of positions in diffusion."""
POSITION_UNIT, GRIP_WEIGHT = 0.02, 0.3
"""m that weigh as much in the loss as 1 in a rotation's column; weight of the gripper."""
PERIODS = (4.0, 8.0, 16.0, 32.0, 64.0)
"""s, of the sines through which the time since the start is seen."""
LATENT, KL = 4, 0.3
"""Numbers of noise that choose among ways in ACT, and the weight that keeps them standard normal."""
STEPS, DENOISE = 50, 8
"""Noise levels in training, and of these visited in acting (DDIM; Song et al. 2021)."""

Inputs = dict[str, Tensor]


class Block(nn.Module):  # type: ignore[misc]
    """A residual block that the prompt modulates (FiLM; Perez et al. 2018)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.film = nn.Linear(WIDTH, width)
        self.inner, self.outer = nn.Linear(width, width), nn.Linear(width, width)

    def forward(self, h: Tensor, prompt: Tensor) -> Tensor:
        """(B, width)."""
        inside = F.silu(self.inner(self.norm(h)) * (1 + self.film(prompt)))
        return h + self.outer(inside)


class Trunk(nn.Module):  # type: ignore[misc]
    """From the inputs, and numbers besides, to a vector; and the anchors that answers count from."""

    def __init__(self, width: int, blocks: int, extra: int) -> None:
        super().__init__()
        seen = ARM + SLOTS * (OBJECT + 9) + WIDTH + 2 * len(PERIODS) + extra
        self.first = nn.Linear(seen, width)
        self.blocks = nn.ModuleList(Block(width) for _ in range(blocks))

    def forward(self, inputs: Inputs, *extra: Tensor) -> Tensor:
        """(B, width)."""
        arm, objects, start, prompt = (inputs[k] for k in ("arm", "objects", "start", "prompt"))
        there = objects[..., 9:]
        relative = (objects[..., :3] - arm[:, None, :3]) * there
        moved = (objects[..., :3] - start) * there
        rows = torch.cat(
            [relative / 0.2, torch.tanh(relative / FINE), torch.tanh(moved / FINE), objects], -1
        )
        centre = arm.new_tensor([0.5, 0.0, 0.2] + [0.0] * (ARM - 3))
        unit = arm.new_tensor([0.2] * 3 + [1.0] * (ARM - 3))
        angle = 2 * torch.pi * inputs["clock"] / arm.new_tensor(PERIODS)
        clock = torch.cat([torch.sin(angle), torch.cos(angle)], -1)
        seen = [(arm - centre) / unit, rows.flatten(1), prompt, clock, *extra]
        h = self.first(torch.cat(seen, -1))
        for block in self.blocks:
            h = block(h, prompt)
        return h


def anchors(inputs: Inputs) -> tuple[Tensor, Tensor]:
    """(B, K, 3) places from the TCP that answers may count from, and (B, K) whether each is there.

    The TCP itself, each object, and where the target was at the start.
    """
    arm, objects, start = inputs["arm"], inputs["objects"], inputs["start"]
    tcp = arm[:, None, :3]
    places = torch.cat([tcp, objects[..., :3], start[:, :1]], 1) - tcp
    here = torch.ones_like(objects[:, :1, 9])
    return places, torch.cat([here, objects[..., 9], here], 1)


class Head(nn.Module):  # type: ignore[misc]
    """From a vector to a chunk of answers, each position a mixture of anchors and an offset.

    So an object that lies 1 cm further left moves what is done to it by 1 cm, for every task at once.
    """

    def __init__(self, width: int, chunk: int) -> None:
        super().__init__()
        self.chunk, self.places = chunk, SLOTS + 2
        self.norm = nn.LayerNorm(width)
        self.last = nn.Linear(width, chunk * (self.places + ANSWER))

    def forward(self, h: Tensor, inputs: Inputs) -> Tensor:
        """(B, chunk, ANSWER), positions from the TCP (m)."""
        out = self.last(F.silu(self.norm(h))).unflatten(-1, (self.chunk, -1))
        places, there = anchors(inputs)
        logits = out[..., : self.places] - 1e4 * (1 - there[:, None])
        mixed = torch.softmax(logits, -1) @ places
        rest = out[..., self.places :]
        turned = inputs["arm"][:, None, 3:9] + rest[..., 3:9]
        return torch.cat([mixed + STEP_UNIT * rest[..., :3], turned, rest[..., 9:]], -1)


class Network(nn.Module, ABC):  # type: ignore[misc]
    """Base of the three networks.

    Attributes:
        chunk: control steps of an answer.
        play: of these, how many are played before the next.
        noise: numbers of noise it wants, 0 for none; one draw lasts an episode.
    """

    chunk: int
    play: int
    noise: int

    def forward(
        self,
        arm: Tensor,
        objects: Tensor,
        start: Tensor,
        prompt: Tensor,
        clock: Tensor,
        noise: Tensor,
    ) -> Tensor:
        """(B, chunk, ANSWER) absolute, as ``policy_inputs`` describes them; ``clock`` (B, 1) is in s."""
        inputs = {"arm": arm, "objects": objects, "start": start, "prompt": prompt, "clock": clock}
        answer = self.answer(inputs, noise)
        return torch.cat([answer[..., :3] + arm[:, None, :3], answer[..., 3:]], -1)

    @abstractmethod
    def answer(self, inputs: Inputs, noise: Tensor) -> Tensor:
        """(B, chunk, ANSWER), positions from the TCP."""

    @abstractmethod
    def loss(self, inputs: Inputs, target: Tensor, mask: Tensor) -> Tensor:
        """Loss of answers (B, chunk, ANSWER), positions from the TCP, where ``mask`` (B, chunk) is 1."""


class BehaviourCloning(Network):
    """One step at a time, and no noise: where ways part, it answers with something between them."""

    def __init__(self, width: int = 384, blocks: int = 4) -> None:
        super().__init__()
        self.chunk, self.play, self.noise = 1, 1, 0
        self.trunk, self.head = Trunk(width, blocks, 0), Head(width, 1)

    def answer(self, inputs: Inputs, noise: Tensor) -> Tensor:  # noqa: ARG002
        """See ``Network``."""
        return self.head(self.trunk(inputs), inputs)

    def loss(self, inputs: Inputs, target: Tensor, mask: Tensor) -> Tensor:
        """Distance of the answers."""
        return distance(self.answer(inputs, target), target, mask)


class Chunks(Network):
    """Action chunks with a latent that tells ways apart (Zhao et al. 2023, ACT), here without attention."""

    def __init__(self, width: int = 384, blocks: int = 4, chunk: int = 30, play: int = 15) -> None:
        super().__init__()
        self.chunk, self.play, self.noise = chunk, play, LATENT
        self.trunk, self.head = Trunk(width, blocks, LATENT), Head(width, chunk)
        self.encoder = Trunk(width, 1, chunk * ANSWER)
        self.latent = nn.Linear(width, 2 * LATENT)

    def answer(self, inputs: Inputs, noise: Tensor) -> Tensor:
        """See ``Network``."""
        return self.head(self.trunk(inputs, noise), inputs)

    def loss(self, inputs: Inputs, target: Tensor, mask: Tensor) -> Tensor:
        """Distance of the answers, and of the latent's distribution from a standard normal one."""
        seen = in_units(target) * mask[..., None]
        mean, spread = self.latent(self.encoder(inputs, seen.flatten(1))).chunk(2, -1)
        spread = spread.clamp(-8, 4)
        latent = mean + torch.exp(spread / 2) * torch.randn_like(mean)
        off = 0.5 * (mean**2 + torch.exp(spread) - 1 - spread).sum(-1).mean()
        return distance(self.answer(inputs, latent), target, mask) + KL * off


class Diffusion(Network):
    """Denoises a chunk (Chi et al. 2023, Diffusion Policy), predicting the clean one; DDIM in acting."""

    def __init__(self, width: int = 384, blocks: int = 4, chunk: int = 30, play: int = 15) -> None:
        super().__init__()
        self.chunk, self.play, self.noise = chunk, play, chunk * ANSWER
        self.trunk, self.head = Trunk(width, blocks, chunk * ANSWER + 16), Head(width, chunk)
        share = torch.linspace(0, 1, STEPS + 1)
        kept = torch.cos((share + 0.008) / 1.008 * math.pi / 2) ** 2  # Nichol & Dhariwal 2021
        self.register_buffer("kept", (kept / kept[0]).clamp(1e-4, 0.9999))

    def clean(self, inputs: Inputs, noisy: Tensor, level: Tensor) -> Tensor:
        """(B, chunk, ANSWER) from a noisy chunk in units, and its level (B,) 0 … STEPS."""
        angle = level[:, None] / STEPS * torch.pi * 2 ** torch.arange(8, device=level.device)
        return self.head(
            self.trunk(inputs, noisy.flatten(1), torch.sin(angle), torch.cos(angle)), inputs
        )

    def answer(self, inputs: Inputs, noise: Tensor) -> Tensor:
        """See ``Network``."""
        noisy = noise.unflatten(-1, (self.chunk, ANSWER))
        levels = [round(STEPS * (1 - i / DENOISE)) for i in range(DENOISE + 1)]
        answer = noisy
        for now, then in pairwise(levels):
            a, b = self.kept[now], self.kept[then]
            answer = self.clean(inputs, noisy, torch.full_like(noise[:, 0], float(now)))
            clean = in_units(answer)
            left = (noisy - a.sqrt() * clean) / (1 - a).sqrt()
            noisy = b.sqrt() * clean + (1 - b).sqrt() * left
        return answer

    def loss(self, inputs: Inputs, target: Tensor, mask: Tensor) -> Tensor:
        """Squared error of the clean chunk, at a random level of noise."""
        goal = in_units(target) * mask[..., None]
        level = torch.randint(1, STEPS + 1, (len(goal),), device=goal.device)
        kept = self.kept[level][:, None, None]
        noisy = kept.sqrt() * goal + (1 - kept).sqrt() * torch.randn_like(goal)
        found = in_units(self.clean(inputs, noisy, level.float()))
        weight = found.new_tensor([25.0] * 3 + [4.0] * 6 + [0.5])
        off = ((found - goal) ** 2 * weight).mean(-1)
        return (off * mask).sum() / mask.sum()


KINDS: dict[str, type[Network]] = {"bc": BehaviourCloning, "act": Chunks, "diffusion": Diffusion}
"""Name → network, as in ``learned:NAME``."""


def distance(answer: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """Mean distance of answers from targets: positions, rotations, and the gripper's cross entropy."""
    place = F.l1_loss(answer[..., :3], target[..., :3], reduction="none").mean(-1) / POSITION_UNIT
    turn = F.l1_loss(answer[..., 3:9], target[..., 3:9], reduction="none").mean(-1) * 5
    closed = (target[..., 9] > 0).to(answer.dtype)
    grip = F.binary_cross_entropy_with_logits(answer[..., 9], closed, reduction="none")
    return ((place + turn + GRIP_WEIGHT * grip) * mask).sum() / mask.sum()


def in_units(answer: Tensor) -> Tensor:
    """Answers with positions in ``STEP_UNIT``, so that all parts are of one size."""
    return torch.cat([answer[..., :3] / STEP_UNIT, answer[..., 3:]], -1)


def made(kind: str, **sizes: Any) -> Network:
    """A network of a kind, its weights random."""
    return KINDS[kind](**sizes)
