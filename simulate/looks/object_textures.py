"""Prints of single things: labels of cans and boxes, covers and pages of books, screens, keys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .surface_textures import F64, SIDE, SIZE, Color, blended, fractal, grid, shaded

PALE: Color = (0.94, 0.93, 0.89)
DARK: Color = (0.12, 0.12, 0.14)
STEEL: Color = (0.74, 0.75, 0.77)
PAGES: Color = (0.93, 0.9, 0.82)
STICKERS: tuple[Color, ...] = (
    (0.75, 0.1, 0.12), (0.9, 0.45, 0.1), (0.1, 0.3, 0.7),
    (0.1, 0.55, 0.25), (0.95, 0.85, 0.15), (0.94, 0.94, 0.94),
)  # fmt: skip
"""Of a cube's sides, in the order of ``SIDES``."""


@dataclass(frozen=True)
class Face:
    """One side of a shape.

    Attributes:
        side: which, of ``SIDES``.
        size: width and height, m.
        color: its ground.
        painted: whether that colour is to be over all, as a role's is, many-coloured prints too.
        rng: what its texture is drawn from.
    """

    side: str
    size: tuple[float, float]
    color: Color
    painted: bool
    rng: np.random.Generator

    def ground(self) -> F64:
        """(SIDE, SIDE, 3) of its colour alone."""
        return shaded(self.color, np.ones(SIZE))


Cell = Callable[[Face], F64]
"""Texture of a side of a shape, (SIDE, SIDE, 3): of ±x y and z, of ±y x and z, of ±z x and y, from bottom left."""
SIDES = ("+x", "-x", "+y", "-y", "+z", "-z")
"""In the order in which MuJoCo's cube textures have them."""


def _around() -> tuple[F64, F64]:
    """Like ``grid``, but y is the height on a cylinder onto which the picture of a side is projected."""
    y, x = grid(SIZE)
    return 0.5 + (y - 0.5) / np.sqrt(1 + (2 * x - 1) ** 2), x


def can(face: Face) -> F64:
    """Metal ends, a label with a band and a disc around."""
    out = shaded(STEEL, np.ones(SIZE))
    if face.side[1] == "z":
        return out
    y, x = _around()
    out = blended(out, face.color, np.abs(y - 0.5) < 0.33)
    disc = np.hypot(x - 0.5, y - 0.57) < 0.14
    out = blended(out, PALE, disc | (np.abs(y - 0.25) < 0.03))
    return blended(out, np.multiply(face.color, 0.55), disc & (np.abs(y - 0.57) < 0.04))


def labelled(face: Face) -> F64:
    """A bottle or jar of its own colour, with a paper label around."""
    y, _ = _around()
    out = face.ground()
    if face.side[1] == "z":
        return out
    printed = (np.abs(y - 0.4) < 0.05) & (fractal(face.rng, SIZE, slope=0.2) > 0.1)
    out = blended(out, PALE, np.abs(y - 0.45) < 0.2)
    out = blended(out, np.multiply(face.color, 0.6), np.abs(y - 0.55) < 0.025)
    return blended(out, DARK, 0.7 * printed)


def striped(face: Face) -> F64:
    """A cup of paper with two bands around."""
    y, _ = _around()
    band = ((np.abs(y - 0.5) < 0.1) | (np.abs(y - 0.3) < 0.03)) & (face.side[1] != "z")
    return blended(face.ground(), np.multiply(face.color, (0.3, 0.5, 0.75)), band)


def cube_texture(
    half: Sequence[float], color: Color, rng: np.random.Generator, cell: Cell, *, painted: bool
) -> F64:
    """(6 SIDE, SIDE, 3): the sides of a shape of such half sizes (m), laid and turned as MuJoCo's cube textures."""
    x, y, z = (2 * side for side in half)
    sizes = {"x": (y, z), "y": (x, z), "z": (x, y)}
    cells = [cell(Face(side, sizes[side[1]], color, painted, rng)) for side in SIDES]
    right, left, up, down, front, back = cells
    return np.concatenate(
        [
            right[::-1, ::-1].transpose(1, 0, 2), left[:, ::-1].transpose(1, 0, 2),
            up, down[::-1], front[::-1], back[::-1, ::-1],
        ]
    )  # fmt: skip


def carton(face: Face) -> F64:
    """A printed carton: a picture and a title on the large sides, print on the narrow ones."""
    y, x = grid(SIZE)
    out = face.ground()
    accent = np.multiply(face.color, 0.6)  # no other hue that could be taken for a role
    if not face.painted:
        accent = np.clip(np.roll(0.8 * np.array(face.color), 1) + 0.15, 0, 1)
    title = (np.abs(y - 0.8) < 0.07) & (np.abs(x - 0.5) < 0.38)
    broken = fractal(face.rng, (1, SIDE), slope=0.4, finest=16) > -0.5
    out = blended(out, PALE, title & broken)
    if (face.side[1] != "z" and min(face.size) >= 0.6 * max(face.size)) or face.size[0] > 0.1:
        picture = np.hypot((x - 0.5) / 0.33, (y - 0.4) / 0.24) < 1
        out = blended(out, shaded(accent, 1 + 0.15 * fractal(face.rng, SIZE)), picture)
    else:
        lines = (np.abs((y * 14) % 1 - 0.5) < 0.18) & (y < 0.62) & (np.abs(x - 0.5) < 0.32)
        out = blended(out, PALE, 0.6 * (lines & (fractal(face.rng, SIZE, slope=0.3) > -0.6)))
    return blended(out, np.multiply(face.color, 0.6), y < 0.08)


def kraft(face: Face) -> F64:
    """Plain board or paper bag: fibres, a crease."""
    out = shaded(face.color, 1 + 0.05 * fractal(face.rng, SIZE, slope=0.6, stretch=(1.0, 4.0)))
    _, x = grid(SIZE)
    return blended(out, np.multiply(face.color, 0.8), 0.5 * (np.abs(x - 0.5) < 0.008))


def book(face: Face) -> F64:
    """Lying: covers above and below, the spine at −x, pages on the other three sides."""
    y, x = grid(SIZE)
    if face.side in ("+x", "+y", "-y"):
        sheets = shaded(
            PAGES, 1 + 0.12 * np.sin(2 * np.pi * 20 * y) + 0.04 * fractal(face.rng, SIZE)
        )
        return blended(sheets, face.color, np.abs(y - 0.5) > 0.42)
    out = face.ground()
    if face.side == "-x":
        return blended(out, PALE, (np.abs(x - 0.5) < 0.25) & (np.abs(y - 0.5) < 0.12))
    frame = (np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) > 0.42) & (
        np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) < 0.45
    )
    out = blended(out, (0.85, 0.72, 0.4), frame)
    return blended(out, (0.85, 0.72, 0.4), (np.abs(y - 0.68) < 0.05) & (np.abs(x - 0.5) < 0.3))


def screen(face: Face) -> F64:
    """A phone: glass with a lit screen above, plain below."""
    out = face.ground()
    if face.side != "+z":
        return out
    y, x = grid(SIZE)
    lit = (np.abs(x - 0.5) < 0.45) & (np.abs(y - 0.5) < 0.46)
    glow = shaded(
        (0.16, 0.25, 0.42), 1 + 0.5 * (y - 0.5) + 0.15 * fractal(face.rng, SIZE, slope=2.0)
    )
    out = blended(out, np.clip(glow + 0.5 * (np.asarray(face.color) - DARK).clip(0), 0, 1), lit)
    icon = lit & (np.abs((4 * x) % 1 - 0.5) < 0.25) & (np.abs((7 * y) % 1 - 0.5) < 0.25)
    shade = 0.4 + 0.6 * face.rng.random((7, 4, 3))
    each = shade[(7 * y).astype(int), (4 * x).astype(int)]
    return blended(out, each, 0.85 * (icon & ((y < 0.25) | (y > 0.6))))


def display(face: Face) -> F64:
    """A laptop's lid: the picture is on −x."""
    out = face.ground()
    if face.side != "-x":
        return out
    y, x = grid(SIZE)
    lit = (np.abs(x - 0.5) < 0.46) & (np.abs(y - 0.52) < 0.42)
    out = blended(out, shaded((0.2, 0.32, 0.45), 1 + 0.3 * fractal(face.rng, SIZE, slope=2.0)), lit)
    window = (np.abs(x - 0.45) < 0.28) & (np.abs(y - 0.55) < 0.26)
    out = blended(out, PALE, window)
    lines = (
        window & (np.abs((16 * y) % 1 - 0.5) < 0.2) & (fractal(face.rng, SIZE, slope=0.5) > -0.5)
    )
    return blended(out, (0.35, 0.38, 0.42), 0.7 * lines)


def keys(face: Face) -> F64:
    """Keys in rows on the upper side."""
    out = face.ground()
    if face.side != "+z":
        return out
    y, x = grid(SIZE)
    rows, columns = (6, 15) if face.size[0] > face.size[1] else (15, 6)
    gap = (np.abs((columns * x) % 1 - 0.5) > 0.4) | (np.abs((rows * y) % 1 - 0.5) > 0.4)
    return blended(out, np.multiply(face.color, 0.35), 0.9 * gap)


def lettered(face: Face) -> F64:
    """A sheet of paper with lines of print on both sides."""
    y, x = grid(SIZE)
    out = face.ground()
    if face.side[1] != "z":
        return out
    ragged = 0.42 - 0.12 * face.rng.random(40)[(20 * y).astype(int)]
    lines = (np.abs((20 * y) % 1 - 0.5) < 0.2) & (np.abs(y - 0.45) < 0.36) & (x < 0.5 + ragged)
    words = fractal(face.rng, SIZE, slope=0.1) > -0.7
    return blended(out, DARK, 0.6 * (lines & (x > 0.12) & words))


def stickers(face: Face) -> F64:
    """A puzzle cube: three by three stickers, a colour per side."""
    y, x = grid(SIZE)
    seam = (np.abs((3 * x) % 1 - 0.5) > 0.42) | (np.abs((3 * y) % 1 - 0.5) > 0.42)
    own = shaded(STICKERS[SIDES.index(face.side)], np.ones(SIZE))
    own = blended(own, face.color, np.full(SIZE, 0.8 * face.painted))
    return blended(own, DARK, seam)


PRINTS: dict[tuple[str, int], Cell] = {
    **{(name, 0): book for name in ("hardback", "pocket_dictionary")},
    **{(name, 0): screen for name in ("smartphone", "small_smartphone")},
    **{(name, 0): carton for name in ("dvd_case", "biscuit_tin")},
    **{
        (name, 0): can
        for name in ("coffee_can", "drink_can", "soup_can", "flour_tin", "paint_can")
    },
    **{(name, 0): labelled for name in ("bottle", "white_bottle", "jam_jar")},
    ("document", 0): lettered, ("rubiks_cube", 0): stickers, ("takeaway_bag", 0): kraft,
    ("paper_cup", 0): striped, ("keyboard", 1): keys, ("laptop", 0): keys, ("laptop", 1): display,
}  # fmt: skip
"""Shapes of things that have a print of their own: (name, index of the shape)."""
