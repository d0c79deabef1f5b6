"""Recordings that grow, made of episodes that are whole."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from safestage_eval.episode import Episode, Header
from safestage_eval.formats import TraceWriter


@dataclass
class Growing:
    """The first ``frames`` frames of an episode, as a recorder would hold them."""

    writer: TraceWriter
    header: Header
    frames: int = 0

    def __len__(self) -> int:
        """T so far."""
        return self.frames

    def window(self, first: int, last: int) -> Episode:
        """Frames first … last − 1."""
        assert last <= self.frames, "a look into the future"
        return self.writer.window(first, last)

    def up_to_now(self) -> Episode:
        """The trace up to now, as one that was cut off; success only if it has come."""
        reached = self.success_time
        so_far = {
            "termination": "truncated",
            "success": reached is not None,
            "success_time": reached,
            "post_success_hold": None,
        }
        header = self.header.model_copy(update=so_far)
        return replace(self.writer.window(0, self.frames), header=header)

    @property
    def success_time(self) -> float | None:
        """s, if it has come."""
        when = self.header.success_time
        now = float(self.writer.window(0, self.frames).t[-1])
        return when if self.header.success and when is not None and when <= now + 1e-6 else None


def growing(episode: Episode) -> Growing:
    """Everything but states and attachments, recorded again frame by frame."""
    header, rows, robot = episode.header, episode.contacts, episode.frames
    writer = TraceWriter(header, meshes=episode.meshes)
    for body in header.bodies:
        if not body.movable:
            track = episode.tracks[body.name]
            writer.set_fixed(body.name, track.position[0], track.orientation[0])
    tracks = [episode.track(body.name) for body in header.bodies if body.movable]
    pose = np.stack([np.hstack([x.position, x.orientation]) for x in tracks], 1)
    twist = np.stack([np.hstack([x.linear_velocity, x.angular_velocity]) for x in tracks], 1)
    cuts = np.searchsorted(rows.frame, np.arange(len(episode) + 1))
    columns = ("geom1", "geom2", "position", "normal", "force", "peak_force", "depth")
    joints = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")
    for i, t in enumerate(episode.t):
        here = slice(cuts[i], cuts[i + 1])
        more = {name: getattr(robot, name)[i] for name in joints if getattr(robot, name).size}
        touching = {name: getattr(rows, name)[here] for name in columns}
        writer.add_frame(
            float(t),
            pose[i],
            twist[i],
            contacts=touching if cuts[i + 1] > cuts[i] else None,
            **more,
        )
    return Growing(writer, header)
