"""Environments of other people's simulators, each with a way to draw actions, for measurements."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

Made = "tuple[Any, Callable[[np.random.Generator], Any]]"


def lift() -> Made:
    """Robosuite's Lift with a Panda, under its own controller."""
    import robosuite

    env = robosuite.make(
        "Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=False,
        use_camera_obs=False, control_freq=20, horizon=100_000, ignore_done=True,
    )  # fmt: skip
    return env, lambda rng: rng.uniform(-0.5, 0.5, env.action_dim)


def fetch() -> Made:
    """Gymnasium-Robotics' pick and place with a Fetch."""
    import gymnasium
    import gymnasium_robotics

    if hasattr(gymnasium, "register_envs"):
        gymnasium.register_envs(gymnasium_robotics)
    names = [name for name in gymnasium.registry if name.startswith("FetchPickAndPlace-v")]
    return gymnasium.make(max(names), max_episode_steps=100_000), lambda rng: rng.uniform(-1, 1, 4)


def metaworld() -> Made:
    """Meta-World's pick and place with a Sawyer."""
    import gymnasium

    import_module("metaworld")  # registers its tasks
    env = gymnasium.make("Meta-World/MT1", env_name="pick-place-v3", seed=0)
    return env, lambda rng: rng.uniform(-1, 1, 4)


def bring_ball() -> Made:
    """dm_control's planar arm."""
    from dm_control import suite

    env = suite.load("manipulator", "bring_ball", task_kwargs={"time_limit": 1e6})
    return env, lambda rng: rng.uniform(-1, 1, env.action_spec().shape)


def pick_cube() -> Made:
    """ManiSkill's PickCube with a Panda, SAPIEN on the CPU."""
    import gymnasium

    import_module("sapien_without_vulkan")
    import_module("mani_skill.envs")
    env = gymnasium.make(
        "PickCube-v1", num_envs=1, obs_mode="state", render_mode=None,
        control_mode="pd_ee_delta_pos", sim_backend="physx_cpu", render_backend="none",
        max_episode_steps=100_000,
    )  # fmt: skip
    return env, lambda rng: np.append(rng.uniform(-1, 1, 3) - [0, 0, 0.4], rng.choice([-1, 1]))


class Kuka:
    """PyBullet's own KUKA arm with a gripper above a cube and a duck on its table."""

    def __init__(self) -> None:
        import pybullet_data
        from pybullet_utils.bullet_client import BulletClient

        self.data = Path(pybullet_data.getDataPath())
        self.p = BulletClient(0x2)  # DIRECT

    def reset(self) -> dict[str, Any]:
        """Put everything where it was."""
        p = self.p
        p.resetSimulation()
        p.setGravity(0, 0, -9.81)
        p.setTimeStep(1 / 240)
        p.loadURDF(str(self.data / "plane.urdf"), [0, 0, -0.62])
        p.loadURDF(str(self.data / "table/table.urdf"), [0.6, 0, -0.62], useFixedBase=True)
        p.loadURDF(str(self.data / "cube_small.urdf"), [0.54, 0.05, 0.031], globalScaling=0.9)
        p.loadURDF(str(self.data / "duck_vhacd.urdf"), [0.66, -0.1, 0.05])
        [self.arm] = p.loadSDF(str(self.data / "kuka_iiwa/kuka_with_gripper2.sdf"))
        p.resetBasePositionAndOrientation(self.arm, [0, 0, 0], [0, 0, 0, 1])
        rest = [0.0, 0.41, 0.0, -1.59, 0.0, 1.14, 0.0, 0, 0, 0, -0.05, 0, 0, 0.05]
        for j, q in enumerate(rest[: p.getNumJoints(self.arm)]):
            p.resetJointState(self.arm, j, q)
        self.aim = np.array([0.54, 0.05, 0.32])
        return {}

    def step(self, action: Any) -> tuple[Any, ...]:
        """12 physics steps toward a place for the hand that ``action`` (4,) moves, and an opening."""
        p = self.p
        self.aim = np.clip(self.aim + 0.02 * action[:3], [0.4, -0.2, 0.22], [0.7, 0.2, 0.5])
        found = p.calculateInverseKinematics(
            self.arm, 6, list(self.aim), p.getQuaternionFromEuler([0, -np.pi, 0])
        )
        for j in range(7):
            p.setJointMotorControl2(
                self.arm, j, p.POSITION_CONTROL, targetPosition=found[j], force=200
            )
        for j, sign in ((8, -1), (11, 1)):
            p.setJointMotorControl2(
                self.arm,
                j,
                p.POSITION_CONTROL,
                targetPosition=sign * 0.3 * (action[3] > 0),
                force=10,
            )
        for _ in range(12):
            p.stepSimulation()
        return {}, 0.0, False, False, {}


def kuka() -> Made:
    """PyBullet's KUKA arm on its table."""
    return Kuka(), lambda rng: np.append(rng.uniform(-1, 1, 3) - [0, 0, 0.3], rng.choice([-1, 1]))


ENVIRONMENTS = {
    "robosuite": lift,
    "gymnasium_robotics": fetch,
    "metaworld": metaworld,
    "dm_control": bring_ball,
    "mani_skill": pick_cube,
    "pybullet": kuka,
}
