"""Textures of single things: labels of cans and boxes, covers and pages of books, screens, keys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .shells import CAP
from .surface_textures import SIDE, SIZE, SURFACES, brushed, smooth, wood
from .texture_noise import F64, Color, blended, fractal, grid, shaded

PALE: Color = (0.94, 0.93, 0.89)
DARK: Color = (0.12, 0.12, 0.14)
STEEL: Color = (0.74, 0.75, 0.77)
PAGES: Color = (0.93, 0.9, 0.82)
STICKERS: tuple[Color, ...] = (
    (0.75, 0.1, 0.12), (0.1, 0.3, 0.7), (0.95, 0.85, 0.15),
    (0.9, 0.45, 0.1), (0.1, 0.55, 0.25), (0.94, 0.94, 0.94),
)  # fmt: skip
"""Names of a cube's sides, in the order of ``shells.SIDES``."""


@dataclass(frozen=True)
class Face:
    """One side of a box.

    Attributes:
        side: which, of ``SIDE_NAMES``.
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


Cell = Callable[[Face], F64]
"""Texture of a side of a box, (SIDE, SIDE, 3)."""
SIDE_NAMES = ("+x", "+y", "+z", "-x", "-y", "-z")
"""In the order of ``shells.SIDES``."""


def surface(material: str | None, color: Color, rng: np.random.Generator) -> F64:
    """(SIDE, SIDE, 3) of a material all over."""
    return SURFACES.get(material or "", smooth)(color, rng)


def can(color: Color, rng: np.random.Generator) -> F64:
    """Around a can: metal ends, a label with a band, a disc and lines of print."""
    y, x = grid(SIZE)
    out = shaded(STEEL, 1 + 0.05 * fractal(rng, SIZE, slope=0.2, stretch=(1.0, 30.0)))
    side = (y - CAP) / (1 - 2 * CAP)
    label = (side > 0.07) & (side < 0.93)
    out = blended(out, smooth(color, rng), label)
    low = 0.2 + 0.1 * rng.random()
    out = blended(out, PALE, label & (side > low) & (side < low + 0.06))
    turned = (3 * x) % 1
    disc = np.hypot((turned - 0.5) * 1.1, (side - 0.66) * 1.0) < 0.16
    out = blended(out, PALE, label & disc)
    out = blended(out, np.multiply(color, 0.55), label & (np.abs(side - 0.66) < 0.04) & disc)
    printed = (np.abs(side - low - 0.16) < 0.025) & (fractal(rng, SIZE, slope=0.1) > -0.2)
    out = blended(out, PALE, 0.8 * (label & printed & (np.abs(turned - 0.5) < 0.3)))
    ring = (np.abs((1 - y) / CAP - 0.85) < 0.08) | (np.abs(y / CAP - 0.85) < 0.08)
    return blended(out, np.multiply(STEEL, 0.7), ring & ((y < CAP) | (y > 1 - CAP)))


def labelled(color: Color, rng: np.random.Generator) -> F64:
    """Around a bottle or jar: its own colour with a paper label."""
    y, x = grid(SIZE)
    out = smooth(color, rng)
    label = (y > 0.22) & (y < 0.58) & (np.abs(((2 * x) % 1) - 0.5) < 0.42)
    out = blended(out, PALE, label)
    out = blended(out, np.multiply(color, 0.6), label & (np.abs(y - 0.5) < 0.025))
    printed = (np.abs(y - 0.38) < 0.05) & (fractal(rng, SIZE, slope=0.2) > 0.1)
    return blended(out, DARK, 0.7 * (label & printed))


def ball(color: Color, rng: np.random.Generator) -> F64:
    """Felt with the seam of a tennis ball."""
    y, x = grid(SIZE)
    seam = np.abs((y - 0.5) - 0.22 * np.sin(4 * np.pi * x)) < 0.025
    return blended(surface("felt", color, rng), PALE, seam)


def striped(color: Color, rng: np.random.Generator) -> F64:
    """Around a cup of paper: two bands."""
    y, _ = grid(SIZE)
    band = (np.abs(y - 0.36) < 0.07) | (np.abs(y - 0.24) < 0.015)
    return blended(smooth(color, rng), np.multiply(color, (0.3, 0.5, 0.75)), band)


def atlas(
    half: Sequence[float],
    color: Color,
    rng: np.random.Generator,
    cell: Cell,
    *,
    painted: bool = False,
) -> F64:
    """(2 SIDE, 3 SIDE, 3): the six sides of a box of such half sizes (m), see ``shells.SIDES``."""
    x, y, z = (2 * side for side in half)
    sizes = ((y, z), (x, z), (x, y))
    cells = [
        cell(Face(name, sizes[i % 3], color, painted, rng)) for i, name in enumerate(SIDE_NAMES)
    ]
    return np.concatenate([np.concatenate(cells[i : i + 3], axis=1) for i in (0, 3)], axis=0)


def covered(material: str | None) -> Cell:
    """All sides of one material; grain runs along the longer edge of each."""

    def cell(face: Face) -> F64:
        picture = surface(material, face.color, face.rng)
        if face.size[1] > face.size[0]:
            picture = picture.transpose(1, 0, 2)
        if material == "wood" and min(face.size) < 0.2 * max(
            face.size
        ):  # a narrow edge: fewer rings
            picture = 0.9 * picture
        return picture

    return cell


def carton(face: Face) -> F64:
    """A printed carton: a picture and a title on the large sides, print on the narrow ones."""
    y, x = grid(SIZE)
    out = smooth(face.color, face.rng)
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
    out = smooth(face.color, face.rng)
    if face.side == "-x":
        return blended(out, PALE, (np.abs(x - 0.5) < 0.25) & (np.abs(y - 0.5) < 0.12))
    frame = (np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) > 0.42) & (
        np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) < 0.45
    )
    out = blended(out, (0.85, 0.72, 0.4), frame)
    return blended(out, (0.85, 0.72, 0.4), (np.abs(y - 0.68) < 0.05) & (np.abs(x - 0.5) < 0.3))


def screen(face: Face) -> F64:
    """A phone: glass with a lit screen above, plain below."""
    out = smooth(face.color, face.rng)
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
    out = smooth(face.color, face.rng)
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
    out = smooth(face.color, face.rng)
    if face.side != "+z":
        return out
    y, x = grid(SIZE)
    rows, columns = (6, 15) if face.size[0] > face.size[1] else (15, 6)
    gap = (np.abs((columns * x) % 1 - 0.5) > 0.4) | (np.abs((rows * y) % 1 - 0.5) > 0.4)
    return blended(out, np.multiply(face.color, 0.35), 0.9 * gap)


def lettered(face: Face) -> F64:
    """A sheet of paper with lines of print on both sides."""
    y, x = grid(SIZE)
    out = smooth(face.color, face.rng)
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
    own = smooth(STICKERS[SIDE_NAMES.index(face.side)], face.rng)
    own = blended(own, face.color, np.full(SIZE, 0.8 * face.painted))
    return blended(own, DARK, seam)


def plain_wood(face: Face) -> F64:
    """A folding rule: wood with a scale along its longer edge."""
    y, x = grid(SIZE)
    out = wood(face.color, face.rng)
    tick = (np.abs((24 * y) % 1 - 0.5) < 0.2) & (x < 0.3)
    return blended(out, DARK, 0.8 * tick) if face.side[1] == "z" else out


def picture(face: Face) -> F64:
    """A landscape: sky, hills, a sun."""
    y, x = grid(SIZE)
    out = blended(
        shaded((0.55, 0.72, 0.9), 1 + 0.1 * y), (0.98, 0.85, 0.4), np.hypot(x - 0.7, y - 0.75) < 0.1
    )
    for base, shade in ((0.5, (0.4, 0.5, 0.55)), (0.36, (0.35, 0.5, 0.3)), (0.2, (0.25, 0.4, 0.2))):
        ridge = base + 0.09 * fractal(face.rng, (1, SIDE), slope=1.8)[0]
        out = blended(out, shade, y < ridge[None, :])
    return blended(out, face.color, np.full(SIZE, 0.8 * face.painted))


BOXES: dict[str, Cell] = {
    "hardback": book, "pocket_dictionary": book, "smartphone": screen, "small_smartphone": screen,
    "document": lettered, "rubiks_cube": stickers, "folding_rule": plain_wood, "dvd_case": carton,
    "takeaway_bag": kraft, "biscuit_tin": carton,
}  # fmt: skip
"""Things whose boxes have a print of their own."""
PARTS: dict[tuple[str, int], Cell] = {
    ("keyboard", 1): keys, ("laptop", 0): keys, ("laptop", 1): display, ("picture_frame", 1): picture,
}  # fmt: skip
"""Single shapes of things that have one: (name, index of the shape)."""
ROUND: dict[str, Callable[[Color, np.random.Generator], F64]] = {
    "tennis_ball": ball, "paper_cup": striped, "bottle": labelled, "white_bottle": labelled,
    "jam_jar": labelled, "marker": smooth, "coffee_can": can, "drink_can": can, "soup_can": can,
    "flour_tin": can, "paint_can": can, "candlestick": brushed,
}  # fmt: skip
"""Round things with a print of their own, on their first shape."""
