"""Poses for viewers in an MCAP trace: ``foxglove.FrameTransforms`` on ``/tf``."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode

from . import protobuf_wire as wire


def transform_messages(
    episode: Episode, times: list[int], every: int
) -> Iterator[tuple[int, bytes]]:
    """(frame, serialised message) of every so many frames; ``times`` (T,) ns, their log times."""
    shown = np.arange(0, len(times), every)
    heads, poses = [], []
    for body in episode.header.bodies:
        track = episode.track(body.name)
        heads.append(wire.field(2, b"world") + wire.field(3, body.name.encode()))
        poses.append(_pose_fields(track.position[shown], track.orientation[shown]))
    for i, n in enumerate(shown.tolist()):
        stamp = wire.stamp(1, times[n])
        yield (
            n,
            b"".join(
                wire.field(1, stamp + head + pose[i].tobytes())
                for head, pose in zip(heads, poses, strict=True)
            ),
        )


def _pose_fields(
    position: NDArray[np.float32], orientation: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """(T, 67) bytes: translation and rotation of a FrameTransform, zeros written out."""
    vector = [
        ("tag_x", "u1"),
        ("x", "<f8"),
        ("tag_y", "u1"),
        ("y", "<f8"),
        ("tag_z", "u1"),
        ("z", "<f8"),
    ]
    layout = np.dtype(
        [
            ("translation", "u1", 2),
            *[(f"t_{name}", kind) for name, kind in vector],
            ("rotation", "u1", 2),
            *[(f"r_{name}", kind) for name, kind in vector],
            ("r_tag_w", "u1"),
            ("r_w", "<f8"),
        ]
    )
    rows = np.empty(len(position), layout)
    rows["translation"] = list(wire.tag(4, wire.LENGTH) + wire.varint(27))
    rows["rotation"] = list(wire.tag(5, wire.LENGTH) + wire.varint(36))
    for number, axis in enumerate("xyz", 1):
        rows[f"t_tag_{axis}"] = rows[f"r_tag_{axis}"] = number << 3 | wire.FIXED64
        rows[f"t_{axis}"] = position[:, number - 1]
        rows[f"r_{axis}"] = orientation[:, number]
    rows["r_tag_w"], rows["r_w"] = 4 << 3 | wire.FIXED64, orientation[:, 0]
    return rows.view(np.uint8).reshape(len(rows), -1)
