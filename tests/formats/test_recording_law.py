"""Recording an episode frame by frame gives that episode, whatever it holds."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from strategies import episodes

from safestage_eval.formats import CONTACT_POINT, TraceWriter

ROBOT = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")


def points_of_frame(contacts, n, rng):
    """The frame's contacts, pairs shuffled and some said from the other side."""
    rows = contacts.where(contacts.frame == n)
    points = np.zeros(len(rows), CONTACT_POINT)
    for name in CONTACT_POINT.names:
        points[name] = getattr(rows, name)
    other = rng.random(len(rows)) < 0.5
    points["geom1"], points["geom2"] = (
        np.where(other, points["geom2"], points["geom1"]),
        np.where(other, points["geom1"], points["geom2"]),
    )
    points["normal"][other] *= -1
    points["force"][other] *= -1
    keys = points["geom1"].astype(int) + points["geom2"]
    # contacts of the same two geoms keep their order: nothing else tells them apart
    return points[np.argsort(rng.permutation(2 * 70000)[keys], kind="stable")]


@given(episodes(max_frames=5), st.booleans(), st.integers(0, 99))
def test_frames_in_episode_out(episode, by_name, seed):
    rng = np.random.default_rng(seed)
    writer = TraceWriter(episode.header, meshes=episode.meshes, frames=1)
    moving = [body.name for body in episode.header.bodies if body.movable]
    for body in episode.header.bodies:
        if not body.movable:
            track = episode.tracks[body.name]
            # velocities of fixed bodies are zero by definition here
            track.linear_velocity[:] = track.angular_velocity[:] = 0
            writer.set_fixed(body.name, track.position[0], track.orientation[0])
    for n, t in enumerate(episode.t):
        tracks = [episode.tracks[name] for name in moving]
        poses = {m: (k.position[n], k.orientation[n]) for m, k in zip(moving, tracks, strict=True)}
        twists = {
            m: (k.linear_velocity[n], k.angular_velocity[n])
            for m, k in zip(moving, tracks, strict=True)
        }
        if not by_name:
            poses = np.array([np.concatenate(p) for p in poses.values()]).reshape(-1, 7)
            twists = np.array([np.concatenate(v) for v in twists.values()]).reshape(-1, 6)
        writer.add_frame(
            t,
            poses,
            twists,
            contacts=points_of_frame(episode.contacts, n, rng),
            **{name: getattr(episode.frames, name)[n] for name in ROBOT},
            channels={key: values[n] for key, values in episode.channels.items()},
        )
    assert writer.episode().content_hash == episode.content_hash
    first = int(rng.integers(len(episode)))
    window = writer.window(first, len(episode))
    assert window.t.tolist() == episode.t[first:].tolist()
    kept = episode.contacts.where(episode.contacts.frame >= first)
    assert window.contacts.frame.tolist() == (kept.frame - first).tolist()
    assert window.contacts.force.tobytes() == kept.force.tobytes()
