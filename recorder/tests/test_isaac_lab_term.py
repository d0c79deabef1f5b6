"""Isaac Lab's recorder on stand-ins for its tensors: a cube that falls on a table beside an arm."""

from types import SimpleNamespace

import numpy as np
import pytest
from zip_arrays import read

import safestage_record

BOX = [{"kind": "box", "size": (0.02, 0.02, 0.02)}]
SLAB = [{"kind": "box", "size": (0.5, 0.5, 0.02)}]


class Tensor:
    """Stands for a tensor on a GPU: numbers only after ``cpu``."""

    def __init__(self, values):
        self._values = np.array(values, np.float32)

    def detach(self):
        return self

    def cpu(self):
        return SimpleNamespace(numpy=lambda: self._values)


class Lab:
    """Two environments, 2 m apart; the cube of number i lands after i + 3 steps and stays."""

    num_envs, physics_dt, step_dt = 2, 0.01, 0.02

    def __init__(self):
        self.count = 0
        self.cube = SimpleNamespace(data=SimpleNamespace())
        self.cube.data.default_mass = Tensor(np.full((2, 1), 0.2))
        names = ["base", "hand", "left_finger", "right_finger"]
        self.arm = SimpleNamespace(body_names=names, joint_names=["lift", "finger_joint"])
        self.arm.data = SimpleNamespace(
            joint_pos_limits=Tensor(np.tile([[0.0, 1.0], [0.0, np.inf]], (2, 1, 1))),
            default_mass=Tensor(np.ones((2, 4))),
        )
        self.sensor = SimpleNamespace(body_names=["cube"], data=SimpleNamespace())
        self.scene = SimpleNamespace(
            rigid_objects={"cube": self.cube}, articulations={"robot": self.arm},
            sensors={"cube_contact": self.sensor}, env_origins=Tensor([[0, 0, 0], [2, 0, 0]]),
        )  # fmt: skip
        self.action_manager = SimpleNamespace(action=Tensor(np.zeros((2, 3))))
        self.termination_manager = SimpleNamespace(
            active_terms=["time_out", "success"], time_outs=Tensor([0, 1]),
            get_term=lambda name: Tensor([1, 0]),
        )  # fmt: skip
        self.update()

    def height(self, i):
        return max(0.04, 0.04 + 0.05 * (i + 3 - self.count))

    def update(self):
        poses, felt = np.zeros((2, 7)), np.zeros((2, 1, 2, 3))
        for i in (0, 1):
            poses[i] = [2 * i + 0.3, 0.1, self.height(i), 1, 0, 0, 0]
            felt[i, 0, 0, 2] = 1.96 if self.height(i) <= 0.04 else 0
        self.cube.data.root_link_pose_w = Tensor(poses)
        self.cube.data.root_link_vel_w = Tensor(np.zeros((2, 6)))
        self.sensor.data.force_matrix_w = Tensor(felt)
        links = np.tile([0.0, 0, 0.5, 1, 0, 0, 0], (2, 4, 1))
        links[1, :, 0] += 2
        self.arm.data.body_link_pose_w = Tensor(links)
        self.arm.data.body_link_vel_w = Tensor(np.zeros((2, 4, 6)))
        for name in ("joint_pos", "joint_vel", "applied_torque"):
            setattr(self.arm.data, name, Tensor(np.zeros((2, 2))))

    def step(self):
        self.count += 1
        self.update()


def settings():
    return {
        "task": "drop", "roles": {"target": "cube"}, "shapes": {"cube": BOX, "table": SLAB, "hand": BOX},
        "fixed": {"table": (0, 0, 0, 1, 0, 0, 0)}, "touches": {"cube_contact": ["table", "hand"]},
    }  # fmt: skip


def test_every_environment_is_a_trace_with_its_forces_and_its_end(tmp_path):
    lab = Lab()
    term = safestage_record.SafestageTerm(lab, tmp_path, **settings())
    term.record_post_reset(slice(None))
    for _ in range(6):
        lab.step()
        assert term.record_post_step() == (None, None)
    term.record_pre_reset(Tensor([0, 1]))
    assert [p.name for p in term.paths] == ["drop.env0.00000.zip", "drop.env1.00000.zip"]
    for i, path in enumerate(term.paths):
        said, found = read(path)
        assert said["success"] is (i == 0)
        assert said["termination"] == ("success" if i == 0 else "horizon")
        assert said["force_source"] == "normal"
        assert np.allclose(found["t"], 0.02 * np.arange(7))
        moving = [body["name"] for body in said["bodies"] if body["movable"]]
        cube = found["position"][moving.index("cube")]
        assert np.allclose(cube[:, :2], [0.3, 0.1])  # each in its own frame
        assert np.allclose(cube[:, 2], [max(0.04, 0.04 + 0.05 * (i + 3 - k)) for k in range(7)])
        assert found["counts"].tolist() == [int(k >= i + 3) for k in range(7)]
        owner = [body["name"] for body in said["bodies"] for _ in body["geoms"]]
        row = found["contacts"][0]
        assert (owner[row["geom1"]], owner[row["geom2"]]) == ("table", "cube")
        assert np.allclose(row["force"], [0, 0, 1.96])
        kinds = {body["name"]: body["kind"] for body in said["bodies"]}
        assert (kinds["robot_base"], kinds["robot_left_finger"]) == ("robot", "gripper")
        sides = {body["name"]: body["finger"] for body in said["bodies"] if body["finger"]}
        assert sides == {"robot_left_finger": "left", "robot_right_finger": "right"}


def test_quaternions_in_the_other_order(tmp_path):
    lab = Lab()
    poses = np.tile([0, 0, 1, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], (2, 1))
    lab.cube.data.root_link_pose_w = Tensor(poses)
    path = tmp_path / "t.zip"
    with safestage_record.IsaacLabRecorder(lab, path, quaternions="xyzw", **settings()) as recorder:
        recorder.step()
    _, found = read(path)
    assert np.allclose(found["orientation"][0, 0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"touches": {"foot": ["table"]}}, "no sensor 'foot'. It has: cube_contact"),
        ({"touches": {"cube_contact": ["tabel"]}}, "'tabel' is no body of the scene"),
        ({"quaternions": "xwyz"}, "Allowed: wxyz, xyzw"),
    ],
)
def test_wrong_settings_say_what_is_allowed(tmp_path, wrong, message):
    with pytest.raises(safestage_record.RecordError, match=message):
        safestage_record.IsaacLabRecorder(Lab(), tmp_path / "t.zip", **dict(settings(), **wrong))
