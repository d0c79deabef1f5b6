"""Action chunks from pictures: a small convolutional network finds the objects, and chunks are as in ACT."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 - the usual name

from .networks import KL, LATENT, POSITION_UNIT, Head, Inputs, Network, Trunk, distance, in_units
from .picture_recipe import CAMERAS
from .policy_inputs import ANSWER, ARM, OBJECT
from .prompt_embedding import WIDTH
from .scene_slots import SLOTS

FOUND, THERE = 0.3, 0.1
"""Weights in the loss of where objects are said to be, and of which are there."""
SHIFT = 3
"""Pixels by which a picture is shifted at random in training, at most."""
POINTS, SEEN = 48, 64
"""Places that a camera's network looks at, and numbers that the rest of the network gets besides."""


class Eye(nn.Module):  # type: ignore[misc]
    """A camera's convolutional network: places in the picture that the prompt asks for.

    The end is a spatial softmax (Levine et al. 2016, "End-to-end training of deep visuomotor policies").
    """

    def __init__(self) -> None:
        super().__init__()
        widths = ((3, 32, 5, 2), (32, 48, 3, 2), (48, 64, 3, 1), (64, 96, 3, 2), (96, 96, 3, 1))
        self.layers = nn.ModuleList(
            nn.Conv2d(a, b, size, stride, size // 2) for a, b, size, stride in widths
        )
        self.norms = nn.ModuleList(nn.GroupNorm(8, b) for _, b, _, _ in widths)
        self.asked = nn.Linear(WIDTH, 96)
        self.maps = nn.Conv2d(96, POINTS, 1)

    def forward(self, picture: Tensor, prompt: Tensor) -> Tensor:
        """(B, 3 POINTS) of pictures (B, 3, H, W) in 0 … 1: column and row of each place, and what is there."""
        h = picture - 0.5
        for layer, norm in zip(self.layers, self.norms, strict=True):
            h = F.silu(norm(layer(h)))
        maps = self.maps(h * (1 + self.asked(prompt)[:, :, None, None])).float()
        height, width = maps.shape[-2:]
        weight = torch.softmax(maps.flatten(2), -1).unflatten(-1, (height, width))
        column = (weight.sum(-2) * torch.linspace(-1, 1, width, device=h.device)).sum(-1)
        row = (weight.sum(-1) * torch.linspace(-1, 1, height, device=h.device)).sum(-1)
        return torch.cat([column, row, (weight * maps).sum((-1, -2))], -1)


class PictureChunks(Network):
    """ACT from pictures. Where objects are is learned from their recorded poses, and found when acting."""

    def __init__(self, width: int = 320, blocks: int = 4, chunk: int = 30, play: int = 15) -> None:
        super().__init__()
        self.chunk, self.play, self.noise = chunk, play, LATENT
        self.eyes = nn.ModuleList(Eye() for _ in CAMERAS)
        glance = len(CAMERAS) * 3 * POINTS
        self.look = nn.Sequential(
            nn.Linear(2 * glance + ARM + WIDTH, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, SLOTS * (OBJECT + 3) + SEEN),
        )  # fmt: skip
        self.trunk, self.head = Trunk(width, blocks, LATENT + SEEN), Head(width, chunk)
        self.encoder = Trunk(width, 1, chunk * ANSWER)
        self.latent = nn.Linear(width, 2 * LATENT)

    def forward(  # type: ignore[override]
        self,
        arm: Tensor,
        prompt: Tensor,
        clock: Tensor,
        noise: Tensor,
        pictures: Tensor,
        first: Tensor,
    ) -> Tensor:
        """(B, chunk, ANSWER) as ``Network``; pictures (B, CAMERAS, 3, H, W) in 0 … 255, now and at the start."""
        inputs = {
            "arm": arm,
            "prompt": prompt,
            "clock": clock,
            "pictures": pictures,
            "first": first,
        }
        answer = self.answer(inputs, noise)
        return torch.cat([answer[..., :3] + arm[:, None, :3], answer[..., 3:]], -1)

    def answer(self, inputs: Inputs, noise: Tensor) -> Tensor:
        """See ``Network``."""
        return self._answered(*self._found(inputs), noise)

    def loss(self, inputs: Inputs, target: Tensor, mask: Tensor) -> Tensor:
        """Loss of the answers, as in ACT, plus loss of the objects' places."""
        found, seen, likely = self._found(inputs)
        there = inputs["objects"][..., 9]
        told = {**inputs, "objects": inputs["objects"], "start": inputs["start"]}
        actions = in_units(target) * mask[..., None]
        mean, spread = self.latent(self.encoder(told, actions.flatten(1))).chunk(2, -1)
        spread = spread.clamp(-8, 4)
        latent = mean + torch.exp(spread / 2) * torch.randn_like(mean)
        off = 0.5 * (mean**2 + torch.exp(spread) - 1 - spread).sum(-1).mean()
        acted = distance(self._answered(found, seen, likely, latent), target, mask)
        return acted + KL * off + self._misplaced(found, likely, inputs, there)

    def _misplaced(self, found: Inputs, likely: Tensor, inputs: Inputs, there: Tensor) -> Tensor:
        now = (found["objects"][..., :3] - inputs["objects"][..., :3]).abs().mean(-1)
        turned = (found["objects"][..., 3:9] - inputs["objects"][..., 3:9]).abs().mean(-1)
        then = (found["start"] - inputs["start"]).abs().mean(-1)
        places = ((now + then) / POSITION_UNIT + turned) * there
        are = F.binary_cross_entropy_with_logits(likely, there)
        return FOUND * places.sum() / there.sum() + THERE * are

    def _found(self, inputs: Inputs) -> tuple[Inputs, Tensor, Tensor]:
        """Inputs with the objects as they are seen; (B, SEEN) more; (B, SLOTS) how likely each is there."""
        if self.training and inputs["arm"].is_cuda:
            with torch.autocast("cuda", torch.bfloat16):
                glances = self._glances(inputs)
        else:
            glances = self._glances(inputs)
        out = self.look(torch.cat([*glances, inputs["arm"], inputs["prompt"]], -1)).float()
        slots = out[:, : SLOTS * (OBJECT + 3)].unflatten(-1, (SLOTS, OBJECT + 3))
        centre = slots.new_tensor([0.5, 0.0, 0.05])
        likely = slots[..., 9]
        there = (likely > 0).to(slots.dtype)[..., None]
        objects = torch.cat([centre + 0.2 * slots[..., :3], slots[..., 3:9]], -1) * there
        start = (centre + 0.2 * slots[..., 10:]) * there
        seen = {k: inputs[k] for k in ("arm", "prompt", "clock")}
        seen |= {"objects": torch.cat([objects, there], -1), "start": start}
        return seen, out[:, SLOTS * (OBJECT + 3) :], likely

    def _glances(self, inputs: Inputs) -> list[Tensor]:
        return [
            eye(inputs[when][:, i] / 255, inputs["prompt"])
            for when in ("pictures", "first")
            for i, eye in enumerate(self.eyes)
        ]

    def _answered(self, found: Inputs, seen: Tensor, _likely: Tensor, noise: Tensor) -> Tensor:
        return self.head(self.trunk(found, noise, seen), found)


def augmented(pictures: Tensor, random: torch.Generator) -> Tensor:
    """(B, CAMERAS, 3, H, W) 0 … 255 of the same as uint8: shifted, brighter or darker, of another tint."""
    count, cameras, _, height, width = pictures.shape
    device = pictures.device

    def drawn(least: float, most: float, *shape: int) -> Tensor:
        return least + (most - least) * torch.rand(shape, generator=random, device=device)

    by = torch.randint(-SHIFT, SHIFT + 1, (count, cameras, 2), generator=random, device=device)
    rows = (torch.arange(height, device=device) + by[..., :1]).clamp(0, height - 1)
    columns = (torch.arange(width, device=device) + by[..., 1:]).clamp(0, width - 1)
    b = torch.arange(count, device=device)[:, None, None, None, None]
    c = torch.arange(cameras, device=device)[None, :, None, None, None]
    k = torch.arange(3, device=device)[None, None, :, None, None]
    moved = pictures[b, c, k, rows[:, :, None, :, None], columns[:, :, None, None, :]].float()
    gain = drawn(0.75, 1.25, count, cameras, 1, 1, 1) * drawn(0.9, 1.1, count, cameras, 3, 1, 1)
    return (moved * gain + drawn(-20, 20, count, cameras, 1, 1, 1)).clamp(0, 255)
