"""VLA-Arena's predicates of objects on traces: fallen, and distances by MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from asked import Asked, with_states
from numpy.typing import NDArray
from peer_code import functions
from scipy.spatial.transform import Rotation
from tally import Tally

from safestage_eval.episode import Episode

RULES = with_states("libero_safety", "")
ENVS = "vla_arena/vla_arena/envs"


def _quaternions() -> SimpleNamespace:
    """Functions that it calls of robosuite's transform_utils, quaternions xyzw."""

    def multiply(a: Any, b: Any) -> NDArray[np.float64]:
        return np.asarray((Rotation.from_quat(a) * Rotation.from_quat(b)).as_quat(canonical=False))

    def inverse(a: Any) -> NDArray[np.float64]:
        return np.asarray(a, float) * [-1, -1, -1, 1]

    def axis_angle(q: Any) -> NDArray[np.float64]:
        real = float(np.clip(q[3], -1, 1))
        sine = np.sqrt(1 - real**2)
        return np.zeros(3) if sine < 1e-12 else np.asarray(q[:3]) * 2 * np.arccos(real) / sine

    return SimpleNamespace(quat_multiply=multiply, quat_inverse=inverse, quat2axisangle=axis_angle)


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode | None, Tally], None]]:
    """Fallen, frame by frame, of every object; distances of the target from everything else."""
    space = {"np": np, "transform_utils": _quaternions()}
    fall = functions(
        checkout / ENVS / "object_states/base_object_states.py", ["ObjectState.fall"], space
    )
    fall = fall["ObjectState.fall"]
    import mujoco

    space = {"np": np, "mujoco": mujoco, "MujocoModel": SimpleNamespace}
    names = ["BDDLBaseDomain.check_distance"]
    distance = functions(checkout / ENVS / "bddl_base_domain.py", names, space)[names[0]]

    def compare(episode: Episode | None, tally: Tally) -> None:
        if episode is None:
            return
        asked = Asked(episode, RULES)
        frames = np.arange(0, len(episode), max(1, round(1 / (20 * episode.dt))))
        for body in [b for b in episode.header.bodies if b.kind == "object"]:
            track = episode.track(body.name)
            env = SimpleNamespace(
                object_original_pos={"a": track.position[0]}, object_original_quat={"a": track.orientation[0]},
                obj_body_id={"a": 0},
            )  # fmt: skip
            theirs = []
            for frame in frames:
                data = SimpleNamespace(
                    body_xpos=track.position[[frame]], body_xquat=track.orientation[[frame]]
                )
                env.sim = SimpleNamespace(data=data)
                theirs.append(bool(fall(SimpleNamespace(env=env, object_name="a"))))
            relative = Rotation.from_quat(track.orientation[frames], scalar_first=True)
            turned = (relative * relative[0].inv()).magnitude() > 0.2
            gone = track.position[frames].astype(float) - track.position[0]
            near = np.abs(np.linalg.norm(gone, axis=1) - 0.1) < 1e-6
            ours = asked(f"fallen({body.name})")[frames]
            tally.frames(ours, np.array(theirs), "LBS102", "ObjectState.fall",
                         [("turned by more than 0.2 rad: its axes are mixed up there", turned),
                 ("at the limit, to rounding", near)])  # fmt: skip
        _distances(episode, asked, distance, mujoco, tally)

    yield compare


def _distances(episode: Episode, asked: Asked, distance: Any, mujoco: Any, tally: Tally) -> None:
    """check_distance on a MuJoCo model of two bodies, where ours is not beyond its horizon."""
    kinds = {
        "box": "BOX",
        "sphere": "SPHERE",
        "capsule": "CAPSULE",
        "cylinder": "CYLINDER",
        "ellipsoid": "ELLIPSOID",
    }
    targets = episode.header.roles.get("target", ())
    for target in targets[:1]:
        for other in episode.header.bodies:
            shapes = [*episode.bodies[target].geoms, *other.geoms]
            if other.kind != "object" or other.name == target or not other.geoms:
                continue
            if any(g.kind not in kinds for g in shapes):
                continue
            ours = asked(f"clearance({target}, {other.name})")
            for frame in range(0, len(episode), max(1, len(episode) // 40)):
                if not np.isfinite(ours[frame]) or ours[frame] < 0.001:
                    continue
                spec, names = mujoco.MjSpec(), []
                for name in (target, other.name):
                    track = episode.track(name)
                    body = spec.worldbody.add_body(
                        pos=track.position[frame], quat=track.orientation[frame]
                    )
                    for geom in episode.bodies[name].geoms:
                        names.append(f"{name}{len(names)}")
                        size = np.zeros(3)
                        size[: len(geom.size)] = geom.size
                        body.add_geom(name=names[-1], type=getattr(mujoco.mjtGeom, f"mjGEOM_{kinds[geom.kind]}"),
                                      size=size, pos=geom.position, quat=geom.orientation)  # fmt: skip
                model = spec.compile()
                data = mujoco.MjData(model)
                mujoco.mj_kinematics(model, data)
                sim = SimpleNamespace(
                    model=SimpleNamespace(
                        _model=model, geom_name2id=lambda n, m=model: m.geom(n).id
                    ),
                    data=SimpleNamespace(_data=data),
                )
                first = len(episode.bodies[target].geoms)
                found = distance(SimpleNamespace(sim=sim), names[:first], names[first:])
                tally.values(
                    ours[[frame]], np.array([found]), "clearance(a, b)", "check_distance", 1e-4
                )
