"""Time between rows and sizes of cubes of Isaac Lab's standard tasks, which its recordings do not hold.

Source: github.com/isaac-sim/IsaacLab, isaaclab_tasks/manager_based/manipulation: ``stack/stack_env_cfg.py`` (sim.dt
0.01, decimation 5), ``lift/lift_env_cfg.py`` (0.01, 2), and ``stack/mdp/terminations.py``, by which stacked cubes are
0.0468 m above each other.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from safestage_eval.episode import Geom


@dataclass(frozen=True)
class StandardTask:
    """A task of Isaac Lab.

    Attributes:
        name: a pattern of its environments' names.
        physics_dt: s, ``sim.dt``.
        decimation: physics steps between recorded rows.
        edges: body → edge length of a cube, m.
    """

    name: str
    physics_dt: float
    decimation: int
    edges: Mapping[str, float] = field(default_factory=dict)

    @property
    def dt(self) -> float:
        """Time in s between recorded rows."""
        return self.physics_dt * self.decimation

    def cube(self, body: str) -> Geom | None:
        """Return the shape of a body, if it is a cube of this task."""
        edge = self.edges.get(body)
        return None if edge is None else Geom(kind="box", size=(edge / 2, edge / 2, edge / 2))


TASKS = (
    StandardTask(
        r"Isaac-Stack-Cube-", 0.01, 5, {"cube_1": 0.0468, "cube_2": 0.0468, "cube_3": 0.0468}
    ),
    StandardTask(r"Isaac-Lift-Cube-", 0.01, 2),
)


def standard_task(env_name: str | None) -> StandardTask | None:
    """Return the task of an environment's name, ``Isaac-Stack-Cube-Franka-IK-Rel-Mimic-v0``; None of others."""
    return next((task for task in TASKS if re.match(task.name, env_name or "")), None)
