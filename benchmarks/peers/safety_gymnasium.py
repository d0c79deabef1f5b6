"""Safety-Gymnasium's costs of vases and of leaving the boundary, on traces."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from asked import Asked, with_states
from peer_code import functions
from scipy.spatial.transform import Rotation
from tally import Tally

from safestage_eval.episode import Episode

RULES = with_states("safety_gymnasium", "")
ASSETS = "safety_gymnasium/assets"


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode | None, Tally], None]]:
    """Every object as a vase, the gripper as the agent; four looks a second."""
    speeds = {"np": np, "get_body_xvelp": lambda _model, data, name: data.speed[name]}
    vases = functions(checkout / ASSETS / "free_geoms/vases.py", ["Vases.cal_cost"], speeds)
    walls = functions(checkout / ASSETS / "geoms/sigwalls.py", ["Sigwalls.cal_cost"], {"np": np})
    hazards_of = functions(checkout / ASSETS / "geoms/hazards.py", ["Hazards.cal_cost"], {})
    hazard_cost = hazards_of["Hazards.cal_cost"]
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
                    there.append(hazard_cost(made)["cost_hazards"] > 0)
                tally.frames(asked(f"stands_over({name}, {hazard})")[frames], np.array(there), "SGY101", "Hazards.cal_cost")  # fmt: skip

    yield compare
