"""Episodes of ours as the recorder for other simulators would write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from safestage_record.zip_trace import write_zip

from safestage_eval.episode import Episode
from safestage_eval.formats.contact_points import table_points


def columns(episode: Episode) -> dict[str, Any]:
    """The arrays that the recorder would write of an episode."""
    moving = [body.name for body in episode.header.bodies if body.movable]
    fixed = [body.name for body in episode.header.bodies if not body.movable]
    frames = len(episode)
    arrays = {
        name: np.array(
            [getattr(episode.tracks[body], name) for body in moving], np.float32
        ).reshape(len(moving), frames, width)
        for name, width in (
            ("position", 3), ("orientation", 4), ("linear_velocity", 3), ("angular_velocity", 3)
        )
    }  # fmt: skip
    for name, width in (("position", 3), ("orientation", 4)):
        rows = [getattr(episode.tracks[body], name)[0] for body in fixed]
        arrays[f"fixed_{name}"] = np.array(rows, np.float32).reshape(-1, width)
    for name in ("joint_position", "joint_velocity", "joint_torque", "action", "gripper"):
        arrays[name] = getattr(episode.frames, name)
    for key, mesh in episode.meshes.items():
        arrays[f"mesh/{key}.vertices"], arrays[f"mesh/{key}.faces"] = mesh.vertices, mesh.faces
    counts = np.bincount(episode.contacts.frame, minlength=frames).astype(np.int64)
    return arrays | {"t": episode.t, "contacts": table_points(episode.contacts), "counts": counts}


def written(episode: Episode, path: Path, **changed: Any) -> Path:
    """The file, with some members otherwise."""
    facts = {"frames": len(episode), "header": episode.header.model_dump(mode="json")}
    write_zip(path, facts, columns(episode) | changed)
    return path
