"""Read + score of one stored episode, and its ratio to a plain per-frame python-fcl evaluator.

Both answer the same question in the same run: does the carried target come closer to the protected
object than the limit? The plain evaluator reads the same file and asks python-fcl for the distance
of every pair of shapes in every frame.

    python benchmarks/score.py [EPISODE] [--rules ets] [--runs 7] [--every 1]

``--every N`` lets the plain loop visit every Nth frame only, and scales its time by N.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fcl
import numpy as np

from safestage_eval.episode import Episode, Geom
from safestage_eval.formats import discover
from safestage_eval.geometry.pose import matrix
from safestage_eval.rules import load_rules
from safestage_eval.verdicts.judge import judge

LIMIT = 0.08
"""m, as ``min_clearance`` in rules/ets.toml."""

Shapes = list[tuple[Any, np.ndarray, np.ndarray]]


def fcl_shape(geom: Geom, episode: Episode) -> Any:
    """The python-fcl geometry of a geom."""
    size = geom.size
    if geom.kind == "sphere":
        return fcl.Sphere(size[0])
    if geom.kind == "box":
        return fcl.Box(*(2 * s for s in size))
    if geom.kind == "cylinder":
        return fcl.Cylinder(size[0], 2 * size[1])
    if geom.kind == "capsule":
        return fcl.Capsule(size[0], 2 * size[1])
    if geom.kind == "ellipsoid":
        return fcl.Ellipsoid(*size)
    mesh = episode.meshes[geom.mesh or ""]
    faces = np.column_stack([np.full(len(mesh.faces), 3), mesh.faces]).ravel()
    return fcl.Convex(mesh.vertices.astype(float), len(mesh.faces), faces)


def shapes(episode: Episode, name: str) -> Shapes:
    """(shape, rotation, position in the body frame) of a body's geoms."""
    return [
        (fcl_shape(geom, episode), matrix(geom.orientation), np.array(geom.position))
        for geom in episode.bodies[name].geoms
        if geom.kind != "plane"
    ]


def plain(ref: Any, every: int) -> float:
    """Least distance (m) between target and protected, by python-fcl, frame by frame."""
    episode = ref.open()
    roles = episode.header.roles
    (target,) = roles["target"]
    least = np.inf
    for protected in roles["protected"]:
        tracks = [episode.track(name) for name in (target, protected)]
        bodies = [shapes(episode, name) for name in (target, protected)]
        for frame in range(0, len(episode), every):
            objects = []
            for track, parts in zip(tracks, bodies, strict=True):
                turn, origin = matrix(track.orientation[frame]), track.position[frame]
                objects.append(
                    [
                        fcl.CollisionObject(s, fcl.Transform(turn @ r, turn @ p + origin))
                        for s, r, p in parts
                    ]
                )
            for a in objects[0]:
                for b in objects[1]:
                    least = min(least, fcl.distance(a, b, fcl.DistanceRequest()))
    return float(least)


def timed(function: Callable[[], Any], runs: int) -> tuple[float, Any]:
    """Median wall time (s) of several runs, and the last result."""
    times, result = [], None
    for _ in range(runs):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return statistics.median(times), result


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("episode", nargs="?", help="episode id; default: the first ETS201 one")
    parser.add_argument("--traces", type=Path, default=Path(__file__).parent.parent / "traces")
    parser.add_argument("--rules", default="ets")
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--every", type=int, default=1)
    args = parser.parse_args()
    refs = [ref for ref in discover([args.traces]) if "ETS201" in ref.open().header.rules]
    chosen = [r for r in refs if args.episode in (None, r.episode_id)]
    if not chosen:
        parser.error("no such episode, or none with the assigned rule ETS201")
    ref = chosen[0]
    rules = load_rules([args.rules])
    episode = ref.open()
    judge(episode, rules)  # compile
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    print(
        f"{ref.episode_id}: {len(episode)} frames, {len(episode.header.bodies)} bodies, "
        f"{len(episode.contacts)} contacts"
    )
    ours, result = timed(lambda: judge(ref.open(), rules), args.runs)
    verdict = next(v for v in result.verdicts if v.rule == "ETS201")
    print(f"read + score, all rules of {args.rules!r}: {ours * 1e3:8.1f} ms  ({verdict.verdict})")
    theirs, least = timed(lambda: plain(ref, args.every), 1)
    theirs *= args.every
    print(f"plain python-fcl, one rule:          {theirs * 1e3:8.1f} ms  (least {least:.4f} m)")
    print(f"ratio: {theirs / ours:.1f}")
    said = f"{verdict.value:.4f} m" if verdict.value is not None else "more than it needs to know"
    print(f"least clearance while in transit: {said}; limit {LIMIT} m")


if __name__ == "__main__":
    main()
