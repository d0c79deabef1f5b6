"""One number for the physical content of an episode, whatever file it stands in."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from .body import Body, Joint
from .contacts import ContactTable
from .frames import RobotFrames
from .header import Header
from .track import Track

_DESCRIPTIVE = {"material", "tags"}
"""Body fields that describe rather than measure: an importer may correct them later."""


def content_hash(
    header: Header,
    t: NDArray[np.float64],
    tracks: Mapping[str, Track],
    contacts: ContactTable,
    frames: RobotFrames,
    channels: Mapping[tuple[str, str], NDArray[np.float32]],
) -> str:
    """SHA-256 (hex) over time, motion, contacts, commands and geometry.

    The header's names for the episode (id, task, policy, roles, success, …) are left out, so that
    correcting them keeps the hash; body names, masses and shapes (meshes by their own hash) are in. Floats are hashed in the
    precision in which they are stored: float32, time in float64.
    """
    digest = hashlib.sha256(scene_text(header).encode())

    def feed(name: str, array: NDArray[np.generic], dtype: str) -> None:
        digest.update(f"{name}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array, dtype).data)

    feed("t", t, "<f8")
    for body in header.bodies:
        for name, column in tracks[body.name].columns.items():
            feed(f"{body.name}.{name}", column, "<f4")
    for part in fields(contacts):
        array = getattr(contacts, part.name)
        feed(part.name, array, array.dtype.newbyteorder("<").str)
    for part in fields(frames):
        feed(part.name, getattr(frames, part.name), "<f4")
    for key in sorted(channels):
        feed(f"channel {key}", channels[key], "<f4")
    return digest.hexdigest()


_SCENES: list[tuple[tuple[Body, ...], tuple[Joint, ...], object, str]] = []
"""Bodies, joints and steps of scenes that were met last, and their JSON."""


def scene_text(header: Header) -> str:
    """JSON of what the header says of the scene: bodies, joints, time steps, gravity.

    The same text as before for the same objects: those of stored episodes share them.
    """
    steps = header.physics_dt, header.frame_dt, header.control_dt, header.gravity
    for bodies, joints, others, text in _SCENES:
        if bodies is header.bodies and joints is header.joints and others == steps:
            return text
    scene = {
        # without defaults: a field that a later minor adds must not change older hashes
        "bodies": [
            body.model_dump(mode="json", exclude=_DESCRIPTIVE, exclude_defaults=True)
            for body in header.bodies
        ]
    }
    rest = {
        "physics_dt": header.physics_dt,
        "frame_dt": header.frame_dt,
        "control_dt": header.control_dt,
        "gravity": header.gravity,
        "joints": [joint.model_dump(mode="json", exclude_defaults=True) for joint in header.joints],
    }
    text = f"{json.dumps(scene, sort_keys=True)[:-1]}, {json.dumps(rest, sort_keys=True)[1:]}"
    _SCENES[:] = [(header.bodies, header.joints, steps, text), *_SCENES[:7]]
    return text
