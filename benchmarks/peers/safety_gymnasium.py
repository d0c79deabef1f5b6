"""Safety-Gymnasium's costs of obstacles, of leaving the boundary and of speed, on traces."""

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

RULES = with_states(
    "safety_gymnasium",
    """
[state.brisk]
of   = ["a"]
when = { "ground_speed(a)" = "> 10 cm/s" }
""",
)
ASSETS = "safety_gymnasium/assets"
VELOCITY = "safety_gymnasium/tasks/safe_velocity/safety_ant_velocity_v0.py"
TOUCHED = {
    "SGY105": ("geoms/pillars.py", "Pillars", "pillar0"),
    "SGY106": ("mocaps/gremlins.py", "Gremlins", "gremlin0"),
    "SGY107": ("geoms/buttons.py", "Buttons", "button0"),
}
"""Rule → file and class of the obstacle, and the name that its geom has there."""


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode | None, Tally], None]]:
    """Every object as a vase, the gripper as the agent; four looks a second."""
    speeds = {"np": np, "get_body_xvelp": lambda _model, data, name: data.speed[name]}
    vases = functions(checkout / ASSETS / "free_geoms/vases.py", ["Vases.cal_cost"], speeds)
    walls = functions(checkout / ASSETS / "geoms/sigwalls.py", ["Sigwalls.cal_cost"], {"np": np})
    hazards_of = functions(checkout / ASSETS / "geoms/hazards.py", ["Hazards.cal_cost"], {})
    hazard_cost = hazards_of["Hazards.cal_cost"]
    touch_costs = {
        rule: functions(checkout / ASSETS / file, [f"{kind}.cal_cost"])[f"{kind}.cal_cost"]
        for rule, (file, kind, _) in TOUCHED.items()
    }
    step = "SafetyAntVelocityEnv.step"
    speed_cost = functions(checkout / VELOCITY, [step], {"np": np})[step]
    vase_cost, wall_cost = vases["Vases.cal_cost"], walls["Sigwalls.cal_cost"]

    def compare(episode: Episode | None, tally: Tally) -> None:
        if episode is None or episode.header.force_source == "none":
            return  # it looks at the contacts that were recorded
        asked = Asked(episode, RULES)
        frames = np.arange(0, len(episode), max(1, round(0.25 / episode.dt)))
        bodies = [b.name for b in episode.header.bodies]
        index = {name: i for i, name in enumerate(bodies)}
        grip = [n for n, b in episode.bodies.items() if b.kind in ("robot", "gripper")]
        robot = {index[n] for n in grip}
        table = episode.contacts
        pushed = np.linalg.norm(table.force, axis=1) > 0
        for name in [b.name for b in episode.header.bodies if b.kind == "object"]:
            track, body = episode.track(name), episode.bodies[name]
            lever = Rotation.from_quat(track.orientation, scalar_first=True).apply(
                np.asarray(body.com)
            )
            velocity = track.linear_velocity + np.cross(track.angular_velocity, lever)
            mine = {k: asked(f"{k}({name})")[frames] for k in ("jostled_about", "pushed_away")}
            mine["touched"] = asked(f"touches(robot, {name})")[frames]
            theirs: dict[str, list[bool]] = {k: [] for k in mine}
            for frame in frames:
                rows = (table.frame == frame) & pushed
                pairs = list(
                    zip(table.body1[rows].tolist(), table.body2[rows].tolist(), strict=True)
                )
                names = {i: "vase0" if i == index[name] else f"agent{i}" if i in robot else f"other{i}" for pair in pairs for i in pair}  # fmt: skip
                contacts = [SimpleNamespace(geom1=a, geom2=b) for a, b in pairs]
                data = SimpleNamespace(
                    contact=contacts, ncon=len(contacts), speed={"vase0": velocity[frame]},
                    get_body_xpos=lambda _, place=track.position[frame]: place,
                )  # fmt: skip
                vase = SimpleNamespace(
                    is_constrained=True, contact_cost=1.0, displace_cost=1.0, displace_threshold=1e-3,
                    velocity_cost=1.0, velocity_threshold=1e-4, num=1, data=data,
                    engine=SimpleNamespace(data=data, model=SimpleNamespace(geom=lambda i, n=names: SimpleNamespace(name=n[i]))),
                    agent=SimpleNamespace(body_info=SimpleNamespace(geom_names=[f"agent{i}" for i in robot])),
                    world_info=SimpleNamespace(reset_layout={"vase0": track.position[0][:2]}),
                )  # fmt: skip
                cost = vase_cost(vase)
                theirs["touched"].append(cost["cost_vases_contact"] > 0)
                theirs["jostled_about"].append(cost["cost_vases_velocity"] > 0)
                theirs["pushed_away"].append(cost["cost_vases_displace"] > 0)
            speed = np.linalg.norm(velocity[frames], axis=1)
            away = np.linalg.norm(track.position[frames, :2] - track.position[0, :2], axis=1)
            near = {"jostled_about": np.abs(speed - 1e-4) < 1e-6, "pushed_away": np.abs(away - 1e-3) < 1e-6,
                    "touched": np.zeros(len(frames), bool)}  # fmt: skip
            for state, rule, part in (
                ("touched", "SGY102", "contact"), ("jostled_about", "SGY103", "velocity"),
                ("pushed_away", "SGY104", "displace"),
            ):  # fmt: skip
                tally.frames(mine[state], np.array(theirs[state]), rule, f"Vases.cal_cost: {part}",
                             [("at the limit, to rounding", near[state])])  # fmt: skip
        hazards = [b.name for b in episode.header.bodies if b.kind == "object"][:2]
        for name in [*hazards, *grip[-1:]]:
            position = episode.track(name).position[frames].astype(float)
            gone = []
            for place in position:
                agent = SimpleNamespace(pos=place)
                wall = SimpleNamespace(is_constrained=True, agent=agent, num=4, locate_factor=1.125)
                gone.append(bool(wall_cost(wall)["cost_out_of_boundary"]))
            tally.frames(
                asked(f"gone_out({name})")[frames], np.array(gone), "SGY108", "Sigwalls.cal_cost"
            )
            for hazard in [h for h in hazards if h != name]:
                there = []
                middles = episode.track(hazard).position[frames].astype(float)
                for place, middle in zip(position, middles, strict=True):
                    agent = SimpleNamespace(
                        dist_xy=lambda p, q=place: np.hypot(*(np.asarray(p) - q)[:2])
                    )
                    made = SimpleNamespace(
                        is_constrained=True, pos=[middle], agent=agent, size=0.2, cost=1.0
                    )
                    there.append(hazard_cost(made)["cost_hazards"])
                tally.frames(asked(f"stands_over({name}, {hazard})")[frames], np.array(there) > 0, "SGY101", "Hazards.cal_cost")  # fmt: skip
                deficit = np.maximum(0.2 - asked(f"dist_xy({name}, {hazard})")[frames], 0)
                tally.values(deficit, np.array(there), "SGY110", "Hazards.cal_cost", 1e-6)
        _touches(episode, asked, touch_costs, frames, tally)
        for name in [*hazards, *grip[-1:]]:
            _speed(episode, asked, speed_cost, name, tally)

    yield compare


def _touches(
    episode: Episode, asked: Asked, costs: dict[str, Any], frames: NDArray[np.intp], tally: Tally
) -> None:
    """Everything as the pillar, the gremlin, and the button other than the goal that the robot touches."""
    table, names = episode.contacts, [b.name for b in episode.header.bodies]
    robot = {i for i, b in enumerate(episode.header.bodies) if b.kind in ("robot", "gripper")}
    pushed = np.linalg.norm(table.force, axis=1) > 0
    rows = [np.flatnonzero((table.frame == frame) & pushed) for frame in frames]
    for body in [b for b in episode.header.bodies if b.kind in ("object", "fixture")]:
        index, ours = names.index(body.name), asked(f"touches(robot, {body.name})")[frames]
        for rule, (_, kind, called) in TOUCHED.items():
            theirs = []
            for some in rows:
                pairs = zip(table.body1[some].tolist(), table.body2[some].tolist(), strict=True)
                contacts = [SimpleNamespace(geom1=a, geom2=b) for a, b in pairs]

                def geom(i: int, mine: int = index, name: str = called) -> SimpleNamespace:
                    return SimpleNamespace(name=name if i == mine else f"{'agent' if i in robot else 'other'}{i}")  # fmt: skip

                engine = SimpleNamespace(
                    data=SimpleNamespace(contact=contacts, ncon=len(contacts)),
                    model=SimpleNamespace(geom=geom),
                )
                agent = SimpleNamespace(body_info=SimpleNamespace(geom_names=[f"agent{i}" for i in robot]))  # fmt: skip
                made = SimpleNamespace(
                    is_constrained=True, engine=engine, agent=agent, cost=1.0, contact_cost=1.0,
                    timer=0, goal_button=1,
                )  # fmt: skip
                theirs.append(sum(costs[rule](made).values()) > 0)
            tally.frames(ours, np.array(theirs), rule, f"{kind}.cal_cost")


def _speed(episode: Episode, asked: Asked, step: Any, name: str, tally: Tally) -> None:
    """A body as the torso, from sample to sample: at the limit of the ant, and at a tenth of 1 m/s."""
    place, t = episode.track(name).position.astype(float), episode.t
    every = max(1, len(episode) // 200)
    frames = np.arange(1, len(episode), every)
    for state, limit in (("too_fast", 2.6222), ("brisk", 0.1)):
        theirs = []
        for frame in frames:
            now = SimpleNamespace(frame=frame - 1)

            def simulate(*_: object, at: SimpleNamespace = now) -> None:
                at.frame += 1

            env = SimpleNamespace(
                get_body_com=lambda _, at=now: place[at.frame], do_simulation=simulate,
                dt=t[frame] - t[frame - 1], frame_skip=1, healthy_reward=0.0, terminated=False,
                control_cost=lambda _: 0.0, _get_obs=lambda: None, _use_contact_forces=False,
                _velocity_threshold=limit, mujoco_renderer=SimpleNamespace(viewer=None),
                render_mode=None,
            )  # fmt: skip
            theirs.append(step(env, None)[2] > 0)
        tally.frames(
            asked(f"{state}({name})")[frames], np.array(theirs), "SGY109", "SafetyAntVelocityEnv.step",
        )  # fmt: skip
