"""How ``stack_cube.h5`` was recorded, on a machine without a GPU, by ManiSkill's own recorder.

    pip install mani_skill==3.0.1 torch gymnasium h5py
    python record.py FOLDER

ManiSkill and SAPIEN are under the Apache-2.0 and MIT licences; the recording holds no model or mesh.
The actions are random: another run moves the arm in another way.
"""

import sys

import gymnasium as gym
import sapien.render
import sapien.wrapper.actor_builder
import sapien.wrapper.urdf_loader


class Nothing:
    """Stands for a render material, of which there is none without Vulkan."""

    def __init__(self, *_, **__):
        pass

    def __setattr__(self, name, value):
        pass

    def __getattr__(self, name):
        return lambda *_, **__: None


Builder = sapien.wrapper.actor_builder.ActorBuilder
for module in (sapien.render, sapien.wrapper.urdf_loader, sapien.wrapper.actor_builder):
    if hasattr(module, "RenderMaterial"):
        module.RenderMaterial = Nothing
for name in dir(Builder):
    if (name.startswith("add_") and name.endswith("visual")) or name == "add_visual_from_file":
        setattr(Builder, name, lambda self, *_, **__: self)
Builder.build_render_component = lambda self: None

import mani_skill.envs  # noqa: E402, F401
from mani_skill.utils.wrappers.record import RecordEpisode  # noqa: E402

env = gym.make(
    "StackCube-v1", obs_mode="state", control_mode="pd_joint_delta_pos", render_mode=None,
    sim_backend="cpu", render_backend="none",
)  # fmt: skip
env = RecordEpisode(
    env, output_dir=sys.argv[1], save_trajectory=True, save_video=False,
    trajectory_name="stack_cube", source_type="scripted",
)  # fmt: skip
env.reset(seed=0)
for _ in range(30):
    env.step(env.action_space.sample() * 0.3)
env.close()
