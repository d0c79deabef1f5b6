"""How much faster pruned, certified clearance is than a plain per-frame python-fcl loop.

One run measures both on the same synthetic pick-and-place episode: a robot of twelve links and
nineteen objects against one mug made of ten hulls and a disc, 8,000 frames at 120 Hz.

    python benchmarks/clearance.py [--frames 8000] [--every 1]

``--every N`` lets the plain loop visit every Nth frame only, and scales its time by N.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import fcl
import numpy as np
from machine import machine
from numpy.typing import NDArray

from safestage_eval.episode import Body, Geom, Mesh
from safestage_eval.geometry.group_clearance import SLACK, clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.pose import matrix, product
from safestage_eval.geometry.shape import BodyShape

F64 = NDArray[np.float64]


def about(axis: tuple[float, float, float], angle: F64 | float) -> F64:
    """(…, 4) quaternions of turns about an axis."""
    half = np.asarray(angle, np.float64)[..., None] / 2
    return np.concatenate([np.cos(half), np.sin(half) * np.array(axis)], -1)


def blob(rng: np.random.Generator, count: int, half: F64) -> Mesh:
    """Points scattered over an ellipsoid."""
    v = rng.normal(size=(count, 3))
    return Mesh.build(v / np.linalg.norm(v, axis=1, keepdims=True) * half)


class Scene:
    """Bodies with their tracks, float32 as they are stored."""

    def __init__(self, frames: int, seed: int = 0) -> None:
        self.rng, self.frames = np.random.default_rng(seed), frames
        self.meshes: dict[str, Mesh] = {}
        self.robot: list[Mover] = []
        self.objects: list[Mover] = []
        self.places = self._places(20)
        tool = self._tool_path()
        self._build_robot(tool)
        for i, place in enumerate(self.places):
            self._build_object(i, place, tool)

    def _places(self, count: int) -> F64:
        places: list[F64] = []
        while len(places) < count:
            p = np.append(self.rng.uniform((0.3, -0.45), (0.8, 0.45)), 0.05)
            if all(np.hypot(*(p - q)[:2]) > 0.11 for q in places):
                places.append(p)
        return np.array(places)

    def _tool_path(self) -> F64:
        stops, self.carried = [np.array([0.45, 0.0, 0.45])], []
        while len(stops) * 120 < self.frames + 600:
            i = int(self.rng.integers(1, len(self.places)))
            goal = self.places[i] + np.append(self.rng.uniform(-0.1, 0.1, 2), 0.0)
            lift = np.array([0, 0, 0.18])
            self.carried.append((i, (len(stops) + 1) * 120, (len(stops) + 4) * 120))
            stops += [self.places[i] + lift, self.places[i], self.places[i] + lift]
            stops += [goal + lift, goal, goal + lift]
        s = np.linspace(0, 1, 120, endpoint=False)[:, None]
        ease = s**3 * (10 - 15 * s + 6 * s**2)
        path = [a + (b - a) * ease for a, b in pairwise(stops)]
        return np.concatenate(path)[: self.frames]

    def _add(self, group: list[Mover], geoms: list[Geom], p: F64, q: F64) -> None:
        noise = self.rng.normal(size=(self.frames, 3)) * 1e-6
        shape = BodyShape.build(
            Body(name=f"body{len(self.robot) + len(self.objects)}", kind="object", geoms=geoms),
            self.meshes,
        )
        q = np.broadcast_to(q, (self.frames, 4))
        group.append(Mover.build(shape, (p + noise).astype(np.float32), q.astype(np.float32)))

    def _hull(self, count: int, half: F64, at: F64 | None = None) -> Geom:
        mesh = blob(self.rng, count, half)
        self.meshes[mesh.key] = mesh
        position = tuple(np.zeros(3) if at is None else at)
        return Geom(kind="convex_mesh", mesh=mesh.key, position=position)

    def _build_robot(self, tool: F64) -> None:
        shoulder = np.array([0.0, 0.0, 0.33])
        yaw = np.arctan2(tool[:, 1], tool[:, 0])
        across = about((0, 0, 1), yaw)
        wrist = tool + np.array([0, 0, 0.2])
        elbow = (shoulder + wrist) / 2 + np.array([0, 0, 0.25])
        for start, end, parts in ((shoulder, elbow, 4), (elbow, wrist, 4)):
            d = end - start
            pitch = np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2])
            q = product(across, about((0, 1, 0), pitch))
            for k in range(parts):
                geoms = [Geom(kind="capsule", size=(0.05, 0.06))]
                geoms += [self._hull(60, np.array([0.07, 0.06, 0.06]))] * (k % 2)
                self._add(self.robot, geoms, start + d * (k + 0.5) / parts, q)
        down = product(across, about((1, 0, 0), np.pi))
        self._add(self.robot, [Geom(kind="cylinder", size=(0.035, 0.03))], wrist, down)
        palm = [Geom(kind="box", size=(0.1, 0.03, 0.03)), self._hull(64, np.full(3, 0.04))]
        self._add(self.robot, palm, tool + np.array([0, 0, 0.12]), down)
        for side in (-0.055, 0.055):
            finger = [
                Geom(kind="box", size=(0.008, 0.012, 0.04)),
                Geom(kind="box", size=(0.006, 0.01, 0.015), position=(0, 0, 0.03)),
            ]
            offset = np.stack([side * np.cos(yaw), side * np.sin(yaw), 0 * yaw + 0.05], 1)
            self._add(self.robot, finger, tool + offset, down)

    def _build_object(self, i: int, place: F64, tool: F64) -> None:
        p = np.tile(place, (self.frames, 1))
        for j, start, stop in self.carried:
            if i == j and start < self.frames:
                way = tool[start:stop] - tool[start]
                p[start : start + len(way)] = p[start] + way
                p[start + len(way) :] = p[start] + way[-1]
        half = self.rng.uniform(0.015, 0.05, 3)
        geoms = [
            [Geom(kind="box", size=tuple(half))],
            [Geom(kind="cylinder", size=(half[0], half[1]))],
            [self._hull(int(self.rng.integers(20, 200)), half)],
            self._mug(),
        ][3 if i == 0 else i % 4]
        self._add(self.objects, geoms, p, about((0, 0, 1), float(self.rng.uniform(0, 6))))

    def _mug(self) -> list[Geom]:
        geoms = [Geom(kind="cylinder", size=(0.04, 0.003), position=(0, 0, -0.047))]
        for k in range(10):
            angles = 2 * np.pi * (k + np.linspace(0, 1, 4)) / 10
            corners = [
                (r * np.cos(a), r * np.sin(a), z)
                for a in angles
                for r in (0.037, 0.043)
                for z in (-0.05, 0.05)
            ]
            mesh = Mesh.build(corners)
            self.meshes[mesh.key] = mesh
            geoms.append(Geom(kind="convex_mesh", mesh=mesh.key))
        return geoms


def fcl_shape(geom: Geom, meshes: dict[str, Mesh]) -> Any:
    """Build the shape for python-fcl."""
    size = geom.size
    if geom.kind == "box":
        return fcl.Box(*(2 * s for s in size))
    if geom.kind == "cylinder":
        return fcl.Cylinder(size[0], 2 * size[1])
    if geom.kind == "capsule":
        return fcl.Capsule(size[0], 2 * size[1])
    from scipy.spatial import ConvexHull

    points = meshes[str(geom.mesh)].vertices.astype(np.float64)
    faces = ConvexHull(points).simplices
    flat = np.c_[np.full(len(faces), 3), faces].ravel()
    return fcl.Convex(points, len(faces), flat)


def plain_loop(group: list[Mover], other: Mover, every: int) -> tuple[F64, int]:
    """(T,) least distance per visited frame, and the number of calls."""
    things = [
        (mover, [(fcl.CollisionObject(fcl_shape(g, dict(mover.shape.meshes))), g)
                 for g in mover.shape.geoms])
        for mover in [*group, other]
    ]  # fmt: skip
    frames, calls = range(0, len(other), every), 0
    least = np.full(len(other), np.nan)
    for t in frames:
        for mover, parts in things:
            rotation = matrix(mover.orientation[t])
            for thing, geom in parts:
                at = rotation @ np.array(geom.position) + mover.position[t]
                thing.setTransform(fcl.Transform(rotation, at))
        best = np.inf
        for _, parts in things[:-1]:
            for thing, _ in parts:
                for wall, _ in things[-1][1]:
                    best = min(best, fcl.distance(thing, wall))
                    calls += 1
        least[t] = best
    return least, calls


def fresh(movers: list[Mover]) -> list[Mover]:
    """The same, with nothing prepared."""
    return [Mover(m.shape, m.position, m.orientation) for m in movers]


def best(run: Callable[[], Any], times: int = 5) -> tuple[float, Any]:
    """Milliseconds of the fastest of several runs, and the last result."""
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        result = run()
        spent.append(time.perf_counter() - start)
    return min(spent) * 1e3, result


def growth(scene: Scene, group: list[Mover], mug: Mover) -> None:
    """How the cost of preparing and measuring up to 10 cm grows with what is measured."""

    def cost(first: list[Mover], second: list[Mover]) -> float:
        return best(lambda: clearance_series(fresh(first), fresh(second), 0.1, slack=SLACK))[0]

    def cut(movers: list[Mover], frames: int) -> list[Mover]:
        return [m.at(slice(frames)) for m in movers]

    print("\nprepare + series to 10 cm with slack, ms, against")
    whole = len(mug)
    steps = [whole // 8, whole // 4, whole // 2, whole]
    print(
        "  frames   ", *(f"{n}: {cost(cut(group, n), cut([mug], n)):.1f}" for n in steps), sep="  "
    )
    counts = [4, 8, 16, len(group)]
    print("  bodies   ", *(f"{n}: {cost(group[:n], [mug]):.1f}" for n in counts), sep="  ")
    parts = []
    for n in (1, 3, 6, 11):
        body = Body(name=f"mug of {n}", kind="object", geoms=mug.shape.geoms[:n])
        shape = BodyShape.build(body, scene.meshes)
        part = Mover(shape, mug.position, mug.orientation)
        parts.append(f"{n * sum(len(m.shape) for m in group)}: {cost(group, [part]):.1f}")
    print("  geom pairs", *parts, sep="  ")
    protected = [f"{n}: {cost(scene.robot, scene.objects[:n]):.1f}" for n in (1, 2, 5, 10, 20)]
    print("  protected", *protected, sep="  ")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=8000)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    print(machine())
    scene = Scene(options.frames)
    group, mug = [*scene.robot, *scene.objects[1:]], scene.objects[0]
    start = time.perf_counter()
    clearance_series(fresh(group), fresh([mug]), 0.1)
    print(f"first calls, compiling or loading kernels   {time.perf_counter() - start:9.3f} s")

    def prepare() -> list[Mover]:
        movers = fresh([*group, mug])
        for mover in movers:
            _ = mover.motion
        return movers

    prepared, movers = best(prepare)
    group, mug = movers[:-1], movers[-1]
    print(f"preparing {len(movers)} bodies' motion               {prepared:9.2f} ms")
    results = {}
    for name, run in (
        ("series to 10 cm", lambda: clearance_series(group, [mug], 0.1)),
        ("series to 10 cm with slack", lambda: clearance_series(group, [mug], 0.1, slack=SLACK)),
        ("series to 5 cm with slack", lambda: clearance_series(group, [mug], 0.05, slack=SLACK)),
    ):
        spent, results[name] = best(run)
        print(f"{name:43s} {spent:9.2f} ms")
        if name == "series to 10 cm with slack":
            ours = (prepared + spent) / 1e3
    start = time.perf_counter()
    plain, calls = plain_loop(group, mug, options.every)
    naive = (time.perf_counter() - start) * options.every
    print(f"plain python-fcl loop, {calls:,} calls{'':9s} {naive:9.2f} s")
    print(f"ratio plain : (prepare + series with slack) {naive / ours:9,.0f} ×")
    capped = results["series to 10 cm"]
    seen = ~np.isnan(plain)
    for limit in (0.02, 0.05, 0.08):
        differ = int((((capped.upper < limit) != (plain < limit)) & seen).sum())
        print(f"frames judged differently at {limit * 100:.0f} cm: {differ} of {seen.sum()}")
    growth(scene, group, mug)


if __name__ == "__main__":
    main()
