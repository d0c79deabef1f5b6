"""Records ``robosuite/``: a cube lifted by robosuite's own environment and collector.

In an environment of its own (``pip install robosuite h5py 'mujoco<3.4'``):

    python tests/simulate/foreign/record_robosuite.py

``demo.hdf5`` is what robosuite's collector and its gathering script write, as it is. Beside it:
``assets/``, the collision meshes that its model names, and ``truth.npz``, what the simulator itself
says at each stored state. robosuite is under the MIT licence, the meshes of the arm under Apache 2.0.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
import robosuite
from robosuite.scripts.collect_human_demonstrations import gather_demonstrations_as_hdf5
from robosuite.wrappers import DataCollectionWrapper
from truth import Truth, clear, keep_collision_meshes, shorten_paths

HERE = Path(__file__).parent / "robosuite"
STEPS = 70


def main() -> None:
    """Lift the cube, then gather the episode as robosuite does."""
    arguments = {
        "env_name": "Lift", "robots": "Panda", "has_renderer": False,
        "has_offscreen_renderer": False, "use_camera_obs": False, "control_freq": 20,
        "ignore_done": True, "seed": 3,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        env = DataCollectionWrapper(robosuite.make(**arguments), folder)
        env.reset()
        model = env.sim.model._model
        truth = Truth(model, str(robosuite.__version__))
        truth.note(env.sim.get_state().flatten(), env.sim.data.ctrl)
        for step in range(STEPS):
            env.step(action(env, step))
            truth.note(env.sim.get_state().flatten(), env.sim.data.ctrl)
        assert env.successful, "the cube was not lifted: only successful episodes are gathered"
        env.close()
        clear(HERE)
        gather_demonstrations_as_hdf5(folder, str(HERE), json.dumps(arguments))
    truth.save(HERE / "truth.npz")
    keep_collision_meshes(HERE / "demo.hdf5", HERE / "assets")
    shorten_paths(HERE / "demo.hdf5")


def action(env: DataCollectionWrapper, step: int) -> np.ndarray:
    """(7,) hand velocity and gripper command: over the cube, down, close, up."""
    data = env.sim.data
    hand = data.get_site_xpos("gripper0_right_grip_site")
    cube = data.get_body_xpos("cube_main")
    out = np.zeros(7)
    goal = cube + np.array([0, 0, 0.1]) if step < 15 else cube if step < 35 else hand
    out[6] = -1.0 if step < 35 else 1.0
    if step >= 45:
        goal = hand + np.array([0, 0, 0.05])
    out[:3] = np.clip((goal - hand) * 10, -1, 1)
    return out


if __name__ == "__main__":
    main()
