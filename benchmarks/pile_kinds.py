"""Piles drawn at random: towers, bridges, leaning books, houses of cards, heaps and more."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from pile_parts import Pile, ball, box, cylinder, open_box

Rng = np.random.Generator


def tower(r: Rng, p: Pile) -> None:
    """Boxes on each other, each a little off."""
    z, x, y = 0.0, 0.0, 0.0
    for i in range(r.integers(3, 7)):
        h = r.uniform(0.015, 0.04)
        w = r.uniform(0.025, 0.05)
        p.add(
            f"b{i}",
            (x, y, z + h),
            box(w, r.uniform(0.025, 0.05), h),
            euler=(0, 0, r.uniform(0, 40)),
        )
        x, y, z = x + r.uniform(-0.02, 0.02), y + r.uniform(-0.02, 0.02), z + 2 * h


def bridge(r: Rng, p: Pile) -> None:
    """A board on two to four piers, often with things on it."""
    half, h = r.uniform(0.12, 0.2), r.uniform(0.03, 0.06)
    many = int(r.integers(2, 5))
    xs = np.linspace(-half, half, many) * r.uniform(0.5, 0.9) + r.uniform(-0.01, 0.01, many)
    for i, x in enumerate(xs):
        p.add(f"pier{i}", (x, 0, h), box(r.uniform(0.015, 0.03), 0.03, h))
    p.add("board", (r.uniform(-0.03, 0.03), 0, 2 * h + 0.008), box(half, 0.04, 0.008))
    for i in range(r.integers(0, 3)):
        s = r.uniform(0.015, 0.03)
        x = -0.6 * half + 1.2 * half * (i + r.uniform(0, 0.6)) / 2
        p.add(
            f"load{i}",
            (x, r.uniform(-0.01, 0.01), 2 * h + 0.017 + s),
            box(s, s, s, dense=r.choice([300, 900])),
        )


def books(r: Rng, p: Pile) -> None:
    """A row of books that lean, against a heavy block, a wall, or upright books."""
    many = int(r.integers(3, 7))
    angle = r.uniform(8, 25)
    h = r.uniform(0.07, 0.1)
    if r.random() < 0.4:
        p.add("fix_wall", (-0.05, 0, 0.1), box(0.05, 0.1, 0.1))
    else:
        p.add("block", (-0.05, 0, 0.08), box(0.05, 0.08, 0.08, dense=1200))
    x = 0.0
    for i in range(r.integers(0, 3)):
        t = r.uniform(0.006, 0.015)
        p.add(f"upright{i}", (x + t, 0, h), box(t, 0.06, h))
        x += 2 * t + r.uniform(0, 0.0004)
    lean = np.radians(angle)
    for i in range(many):
        t = r.uniform(0.006, 0.014)
        x += t / np.cos(lean) + (h * np.sin(lean) if i == 0 else 0)
        p.add(
            f"book{i}",
            (x, r.uniform(-0.005, 0.005), h * np.cos(lean) + t * np.sin(lean) + 0.001),
            box(t, 0.06, h),
            euler=(0, -angle, 0),
        )
        x += t / np.cos(lean) + 0.0005


def rack(r: Rng, p: Pile) -> None:
    """Plates that stand leaning in a slotted rack."""
    slots = int(r.integers(3, 5))
    pitch = r.uniform(0.035, 0.05)
    parts = [box(pitch * slots / 2 + 0.01, 0.05, 0.005, at=(0, 0, 0.005), dense=1500)]
    parts += [
        box(0.003, 0.05, 0.02, at=((i - slots / 2) * pitch, 0, 0.03), dense=1500)
        for i in range(slots + 1)
    ]
    p.add("rack", (0, 0, 0), *parts)
    for i in range(slots):
        t, h = r.uniform(0.003, 0.006), r.uniform(0.04, 0.07)
        lean = np.degrees(np.arctan2(pitch / 2 - 0.006 - t, 0.04))
        p.add(
            f"plate{i}",
            ((i + 0.5 - slots / 2) * pitch, 0, 0.012 + h),
            box(t, 0.045, h),
            euler=(0, r.choice([-1, 1]) * lean * 0.7, 0),
        )


def groove(r: Rng, p: Pile) -> None:
    """Balls or a rod in the groove between lying cylinders or boxes."""
    radius = r.uniform(0.03, 0.04)
    gap = r.uniform(0.0, 0.012)
    many = int(r.integers(2, 4))
    xs = (np.arange(many) - (many - 1) / 2) * (2 * radius + gap)
    round_ = r.random() < 0.4
    for i, x in enumerate(xs):
        if round_:
            parts = [
                cylinder(radius, 0.08, euler=(90, 0, 0)),
                box(radius * 0.7, 0.08, 0.004, at=(0, 0, -radius + 0.004), dense=3000),
            ]
        else:
            parts = [box(radius, 0.08, radius)]
        p.add(f"side{i}", (x, 0, radius), *parts)
    for i in range(many - 1):
        small = r.uniform(0.02, 0.03)
        mid = (xs[i] + xs[i + 1]) / 2
        if r.random() < 0.5:
            p.add(f"ball{i}", (mid, r.uniform(-0.03, 0.03), 2 * radius + small), ball(small))
        else:
            p.add(f"rod{i}", (mid, 0, 2 * radius + small), cylinder(small, 0.06, euler=(90, 0, 0)))


def aframe(r: Rng, p: Pile) -> None:
    """Two boards that lean against each other, sometimes with a third, sometimes beside a block."""
    angle = r.uniform(14, 26)
    h, t = r.uniform(0.07, 0.1), 0.005
    a = np.radians(angle)
    x = h * np.sin(a) + t * np.cos(a)
    z = h * np.cos(a) + t * np.sin(a)
    p.add("left", (-x - 0.0002, 0, z), box(t, 0.05, h), euler=(0, angle, 0))
    p.add("right", (x + 0.0002, 0, z), box(t, 0.05, h), euler=(0, -angle, 0))
    if r.random() < 0.5:
        p.add("leaner", (x + 0.024, 0, z), box(t, 0.04, h), euler=(0, -angle, 0))
    if r.random() < 0.5:
        p.add("beside", (0.02, 0.09, 0.03), box(0.03, 0.03, 0.03))
        p.add("topping", (0.02, 0.09, 0.075), box(0.015, 0.015, 0.015))


def hooks(r: Rng, p: Pile) -> None:
    """Hooks over a bar on two posts; things hang in them."""
    h = r.uniform(0.14, 0.18)
    for i, s in enumerate((-1, 1)):
        p.add(f"post{i}", (0, s * 0.13, h / 2), box(0.03, 0.02, h / 2))
    p.add("bar", (0, 0, h + 0.008), box(0.008, 0.17, 0.008))
    for i in range(r.integers(1, 4)):
        y = (i - 1) * 0.06 + r.uniform(-0.005, 0.005)
        drop, up = r.uniform(0.05, 0.08), r.uniform(0.015, 0.025)
        w = 0.014
        reach = r.uniform(0.02, 0.03)
        parts = [
            box(w, 0.01, 0.004, at=(0, 0, 0.004)),
            box(0.004, 0.01, up, at=(-w + 0.004, 0, -up)),
            box(0.004, 0.01, drop / 2, at=(w - 0.004, 0, -drop / 2)),
            box(reach, 0.01, 0.004, at=(w - reach, 0, -drop - 0.004)),
            box(0.004, 0.01, 0.01, at=(w - 2 * reach, 0, -drop + 0.008)),
        ]
        p.add(f"hook{i}", (0, y, h + 0.0165), *parts)
        if r.random() < 0.7:
            s = r.uniform(0.006, 0.009)
            p.add(f"hung{i}", (w - reach, y, h + 0.0165 - drop + s + 0.0005), box(s, s, s))


def bowl(r: Rng, p: Pile) -> None:
    """A bowl on blocks or a box, with balls and boxes in it."""
    z = 0.0
    if r.random() < 0.7:
        h = r.uniform(0.02, 0.04)
        if r.random() < 0.5:
            p.add("stand", (0, 0, h), box(0.04, 0.04, h))
        else:
            for i, s in enumerate((-1, 1)):
                p.add(f"stand{i}", (s * 0.04, 0, h), box(0.015, 0.05, h))
        z = 2 * h
    parts = [cylinder(0.04, 0.003, at=(0, 0, 0.003))]
    for k in range(8):
        c, s = np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)
        parts.append(
            box(
                0.003,
                0.026,
                0.025,
                at=(0.053 * c, 0.053 * s, 0.026),
                euler=(0, 25, 0) if k == 0 else _turned(k),
            )
        )
    p.add("bowl", (0, 0, z + 0.0005), *parts)
    for i in range(r.integers(2, 5)):
        s = r.uniform(0.012, 0.02)
        shape = ball(s) if r.random() < 0.5 else box(s, s, s)
        p.add(
            f"in{i}",
            (r.uniform(-0.015, 0.015), r.uniform(-0.015, 0.015), z + 0.03 + 0.045 * i),
            shape,
        )


def _turned(k: int) -> Sequence[float]:
    """Euler angles (degrees, intrinsic xyz) of a wall that is turned by k/8 and leans out by 25°."""
    about, out = np.radians(45 * k), np.radians(25)
    rz = np.array(
        [[np.cos(about), -np.sin(about), 0], [np.sin(about), np.cos(about), 0], [0, 0, 1]]
    )
    ry = np.array([[np.cos(out), 0, np.sin(out)], [0, 1, 0], [-np.sin(out), 0, np.cos(out)]])
    m = rz @ ry
    return np.degrees(
        [np.arctan2(-m[1, 2], m[2, 2]), np.arcsin(m[0, 2]), np.arctan2(-m[0, 1], m[0, 0])]
    )  # type: ignore[return-value]


def counterweight(r: Rng, p: Pile) -> None:
    """A plank beyond the edge of a block, held by weights on its inner end; a load at the outer."""
    p.add("base", (0, 0, 0.05), box(0.05, 0.05, 0.05, dense=1500))
    over = r.uniform(0.03, 0.1)
    p.add("plank", (over, 0, 0.107), box(0.11, 0.03, 0.007))
    inner = max(over - 0.1, -0.045) + 0.02
    s = r.uniform(0.018, 0.03)
    p.add("weight", (inner, 0, 0.115 + s), box(s, s, s, dense=2000))
    if r.random() < 0.5:
        p.add("weight1", (inner, 0, 0.116 + 2 * s + 0.015), box(0.015, 0.015, 0.015, dense=2500))
    if r.random() < 0.6:
        q = r.uniform(0.008, 0.014)
        p.add("load", (over + r.uniform(0.02, 0.08), 0, 0.115 + q), box(q, q, q, dense=500))


def heap(r: Rng, p: Pile) -> None:
    """Boxes and cylinders dropped on each other, within a low rim."""
    p.add("fix_rim", (0, 0, 0), *open_box(0.08, 0.08, 0.015, 0.005)[1:])
    for i in range(r.integers(5, 10)):
        s = r.uniform(0.02, 0.035, 3)
        shape = box(*s) if r.random() < 0.7 else cylinder(s[0], s[1])
        at = (r.uniform(-0.03, 0.03), r.uniform(-0.03, 0.03), 0.05 + 0.07 * i)
        p.add(f"x{i}", at, shape, euler=tuple(r.uniform(0, 90, 3)))


def nested(r: Rng, p: Pile) -> None:
    """A box in a box in a box, with something in the innermost; perhaps on a stand."""
    z = 0.0
    if r.random() < 0.5:
        p.add("stand", (0, 0, 0.02), box(0.05, 0.05, 0.02))
        z = 0.04
    size = 0.06
    for i in range(r.integers(2, 4)):
        p.add(
            f"box{i}",
            (r.uniform(-0.003, 0.003), r.uniform(-0.003, 0.003), z + 0.0003),
            *open_box(size, size, size * 0.5, 0.003),
        )
        z += 0.0035
        size -= r.uniform(0.012, 0.02)
    for i in range(r.integers(1, 3)):
        s = size * r.uniform(0.3, 0.6)
        p.add(
            f"in{i}",
            (0, 0, z + s + 0.001 + 0.04 * i),
            box(s, s, s) if r.random() < 0.7 else ball(s),
        )


def ramp(r: Rng, p: Pile) -> None:
    """A board leaning up a block, and boxes on it: held by friction, some by a stop."""
    angle = r.uniform(8, 20)
    a = np.radians(angle)
    length = 0.16
    rise = 2 * length * np.sin(a)
    p.add(
        "block",
        (length * np.cos(a) - 0.01, 0, rise / 2 - 0.004),
        box(0.03, 0.06, rise / 2 - 0.004, dense=1000),
    )
    p.add(
        "board", (0, 0, length * np.sin(a) + 0.006), box(length, 0.05, 0.005), euler=(0, -angle, 0)
    )
    up = np.array([-np.sin(a), 0, np.cos(a)])
    along = np.array([np.cos(a), 0, np.sin(a)])
    for i, d in enumerate(np.linspace(-0.09, 0.07, int(r.integers(2, 5)))):
        s = r.uniform(0.013, 0.02)
        shape = box(s, s, s)
        down = 0.0
        if i and r.random() < 0.4:
            shape = cylinder(s, s, euler=(90, 0, 0))
            down = 0.012
        at = (0, 0, length * np.sin(a) + 0.006) + along * (d - down) + up * (0.006 + s)
        p.add(f"on{i}", tuple(at), shape, euler=(0, -angle, 0))


def cantilever(r: Rng, p: Pile) -> None:
    """Bricks that reach out farther and farther, some with a counterweight."""
    x = z = 0.0
    many = int(r.integers(3, 6))
    steps = sorted(r.uniform(0.004, 0.028, many))
    for i in range(many):
        p.add(f"brick{i}", (x, 0, z + 0.012), box(0.05, 0.03, 0.012))
        x, z = x + steps[i], z + 0.024
    if r.random() < 0.6:
        p.add("weight", (x - 0.06 - steps[-1], 0, z + 0.02), box(0.02, 0.02, 0.02, dense=1500))


def cards(r: Rng, p: Pile) -> None:
    """Two tents of cards with a card across."""
    angle = r.uniform(14, 20)
    h, t = 0.06, 0.003
    a = np.radians(angle)
    x, z = h * np.sin(a) + t * np.cos(a), h * np.cos(a) + t * np.sin(a)
    for i in range(2):
        c = (i - 0.5) * (4 * x + 0.01)
        p.add(f"left{i}", (c - x - 0.0002, 0, z), box(t, 0.05, h), euler=(0, angle, 0))
        p.add(f"right{i}", (c + x + 0.0002, 0, z), box(t, 0.05, h), euler=(0, -angle, 0))
    if r.random() < 0.8:
        p.add(
            "across",
            (0, 0, 2 * h * np.cos(a) + 2 * t * np.sin(a) + 0.004),
            box(2 * x + 0.03, 0.05, 0.003),
        )
        if r.random() < 0.5:
            p.add(
                "atop",
                (r.uniform(-0.02, 0.02), 0, 2 * h * np.cos(a) + 2 * t * np.sin(a) + 0.0225),
                box(0.015, 0.015, 0.015),
            )


def tray(r: Rng, p: Pile) -> None:
    """A tray with several things, on a block, two blocks, or a drawer."""
    z = 0.0
    what = r.integers(3)
    if what == 0:
        p.add("under", (0, 0, 0.02), box(0.07, 0.05, 0.02))
        z = 0.04
    elif what == 1:
        for i, s in enumerate((-1, 1)):
            p.add(f"under{i}", (s * 0.07, 0, 0.02), box(0.02, 0.05, 0.02))
        z = 0.04
    else:
        p.add("fix_drawer", (0, 0, 0.1), box(0.15, 0.1, 0.005))
        z = 0.105
    p.add("tray", (r.uniform(-0.01, 0.01), 0, z + 0.0003), *open_box(0.1, 0.06, 0.006, 0.004))
    for i in range(r.integers(2, 5)):
        s = r.uniform(0.012, 0.02)
        shape = box(s, s, 1.5 * s) if r.random() < 0.6 else cylinder(s, 1.5 * s)
        p.add(f"cup{i}", (-0.07 + 0.045 * i, r.uniform(-0.03, 0.03), z + 0.0055 + 1.5 * s), shape)
        if r.random() < 0.3:
            p.add(f"on{i}", (-0.07 + 0.045 * i, 0, z + 0.0065 + 3.9 * s), box(s, s, s * 0.8))


def balls(r: Rng, p: Pile) -> None:
    """Balls in a row between blocks and rails, some on two others."""
    many = int(r.integers(2, 4))
    rad = r.uniform(0.02, 0.028)
    half = many * rad
    for i, s in enumerate((-1, 1)):
        p.add(f"end{i}", (s * (half + 0.03 - 0.0002), 0, 0.03), box(0.03, 0.05, 0.03, dense=900))
    for i, s in enumerate((-1, 1)):
        p.add(f"fix_rail{i}", (0, s * (rad + 0.0045), 0.04), box(half, 0.004, 0.04))
    for i in range(many):
        p.add(f"ball{i}", ((2 * i + 1) * rad - half, 0, rad), ball(rad))
    for i in range(many - 1):
        if r.random() < 0.8:
            p.add(f"top{i}", ((2 * i + 2) * rad - half, 0, rad + 1.75 * rad), ball(rad))


def logs(r: Rng, p: Pile) -> None:
    """Logs stacked between two chocks."""
    rad = r.uniform(0.018, 0.024)
    many = int(r.integers(2, 4))
    fixed = r.random() < 0.5
    for i, s in enumerate((-1, 1)):
        name = f"fix_chock{i}" if fixed else f"chock{i}"
        p.add(name, (s * (many * rad + 0.03), 0, 0.02), box(0.03, 0.06, 0.02, dense=1500))
    row, k = many, 0
    z = rad
    while row:
        for i in range(row):
            p.add(f"log{k}", ((2 * i - row + 1) * rad, 0, z), cylinder(rad, 0.06, euler=(90, 0, 0)))
            k += 1
        row -= 1
        z += 1.74 * rad
        if r.random() < 0.3:
            break


def corbel(r: Rng, p: Pile) -> None:
    """Two corbelled stacks that meet under a slab."""
    span = r.uniform(0.06, 0.09)
    for side, s in (("l", -1), ("r", 1)):
        x = s * (span + 0.04)
        for i in range(3):
            p.add(f"{side}{i}", (x, 0, 0.015 + 0.03 * i), box(0.04, 0.03, 0.015))
            x -= s * r.uniform(0.006, 0.02)
    p.add(
        "slab",
        (r.uniform(-0.01, 0.01), 0, 0.098),
        box(r.uniform(0.06, 0.08) + 0.02, 0.03, 0.008, dense=r.choice([600, 1500])),
    )
    if r.random() < 0.5:
        p.add("load", (r.uniform(-0.03, 0.03), 0, 0.127), box(0.02, 0.02, 0.02))


def shelf(r: Rng, p: Pile) -> None:
    """A shelf of the furniture with stacks on it; things below that do not hang on it."""
    p.add("fix_shelf", (0, 0, 0.15), box(0.15, 0.06, 0.006))
    for i in range(r.integers(1, 4)):
        x, z = -0.1 + 0.1 * i, 0.156
        for k in range(r.integers(1, 4)):
            s = r.uniform(0.018, 0.03)
            h = r.uniform(0.015, 0.03)
            shape = box(s, s, h) if r.random() < 0.6 else cylinder(s, h)
            p.add(f"s{i}{k}", (x + r.uniform(-0.005, 0.005), 0, z + h), shape)
            z += 2 * h
    p.add("below", (0, 0, 0.02), box(0.02, 0.02, 0.02))


KINDS: dict[str, Callable[[Rng, Pile], None]] = {
    f.__name__: f
    for f in (tower, bridge, books, rack, groove, aframe, hooks, bowl, counterweight, heap, nested,
              ramp, cantilever, cards, tray, balls, logs, corbel, shelf)
}  # fmt: skip
