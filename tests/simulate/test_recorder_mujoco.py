"""Contacts computed by the MuJoCo of another interpreter are those of that MuJoCo."""

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from foreign_demos import ASSETS, FOREIGN, demo_file, said, scene, settled

from safestage_eval.importers import Account, MapFile, Settings
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.map_tables import BodyTable
from simulate.importers.mujoco import MujocoStates
from simulate.importers.recorder_mujoco import pushed_by_robot

pytestmark = pytest.mark.simulate

ARM = """
<body name="robot0_link1" pos="0 0 0.3"><joint name="j" axis="0 1 0" limited="false"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 -0.24" size="0.02" mass="2"/></body>
<body name="far" pos="-0.3 0 0.02"><freejoint/><geom type="box" size=".02 .02 .02" mass="0.1"/></body>
<body name="under" pos="0.28 0 0.03"><freejoint/><geom type="box" size=".03 .03 .03" mass="0.1"/></body>
"""
MOTOR = '<actuator><motor name="m" joint="j"/></actuator>'


def read(path, **settings):
    importer, account = MujocoStates(path, Settings(**settings)), Account()
    try:
        return importer.read(importer.episodes()[0], account), account.remarks
    finally:
        importer.close()


@pytest.fixture
def file(tmp_path):
    """An arm that lies on one box, while another box lies alone."""
    text = scene(bodies=ARM, rest=MOTOR)
    return text, demo_file(tmp_path / "d.hdf5", text, settled(text))


def test_forces_on_the_robot_are_unknown_without_its_mujoco(file):
    episode, account = read(file[1])
    names = [body.name for body in episode.header.bodies]
    table = episode.contacts
    known = {
        frozenset((names[a], names[b])): np.isfinite(force).all()
        for a, b, force in zip(table.body1, table.body2, table.force, strict=True)
    }
    assert not known[frozenset(("robot0_link1", "under"))]
    assert not known[frozenset(("world", "under"))]
    assert known[frozenset(("world", "far"))]
    assert "--python" in said(account, "forces on and by the robot").remedy


def test_another_interpreter_gives_what_this_one_does(file, tmp_path):
    text, path = file
    stated = demo_file(tmp_path / "s.hdf5", text, settled(text),
                       about={"mujoco_version": mujoco.__version__})  # fmt: skip
    heavy = MapFile(body={"far": BodyTable(mass=0.3)})
    here, account = read(stated, map=heavy)
    there, remarks = read(path, map=heavy, python=Path(sys.executable))
    assert account == remarks
    assert mujoco.__version__ in said(remarks, "contacts and contact forces").how
    for column in ("frame", "body1", "body2", "position", "normal", "force", "peak_force", "depth"):
        a, b = getattr(here.contacts, column), getattr(there.contacts, column)
        # the model passes through its text, which has six digits
        assert np.allclose(a, b, atol=1e-3 if "force" in column else 1e-6), column
    far = [b.name for b in here.header.bodies].index("far")
    rows = (here.contacts.body2 == far) & (here.contacts.frame == 4)
    assert here.contacts.force[rows, 2].sum() == pytest.approx(0.3 * 9.81, rel=1e-3)


def test_the_motors_of_the_arm_bear_its_weight(tmp_path):
    text = scene(bodies=ARM, rest=MOTOR)
    states = settled(text)
    states[:, 1 + mujoco.MjModel.from_xml_string(text).nq :] = 0
    about = {"mujoco_version": mujoco.__version__}
    episode, _ = read(demo_file(tmp_path / "d.hdf5", text, states, about=about))
    names = [body.name for body in episode.header.bodies]
    table, under = episode.contacts, names.index("under")
    on_floor = [
        float(
            table.force[
                (table.frame == f) & (table.body1 == names.index("world")) & (table.body2 == under),
                2,
            ].sum()
        )
        for f in range(5)
    ]
    assert max(on_floor) < 2 * 9.81 * 0.5  # of the arm's 20 N little more than the overlap gives


def test_a_model_of_robosuite_with_its_meshes_passes_through_files():
    demo = FOREIGN / "robosuite" / "demo.hdf5"
    episode, _ = read(demo, assets=(ASSETS,), python=Path(sys.executable))
    assert np.isfinite(episode.contacts.force).all()
    assert len(episode.contacts) > 100


@pytest.mark.parametrize("body", ["import sys; sys.exit(3)", "raise ImportError('no mujoco here')"])
def test_an_interpreter_that_cannot_do_it_is_named(file, tmp_path, body):
    python = tmp_path / "python"
    python.write_text(f"#!{sys.executable}\n{body}\n")
    python.chmod(0o755)
    with pytest.raises(SourceError, match="--python") as caught:
        read(file[1], python=python)
    assert str(python) in str(caught.value)
    if "mujoco" in body:
        assert "no mujoco here" in str(caught.value)


def test_a_push_goes_on_through_what_moves_but_not_through_the_table():
    xml = """<mujoco><worldbody><geom name="t" type="plane" size="1 1 1"/>
      <body name="r"><freejoint/><geom size=".1"/></body><body name="a"><freejoint/><geom size=".1"/></body>
      <body name="b"><freejoint/><geom size=".1"/></body><body name="c"><freejoint/><geom size=".1"/></body>
    </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    points = np.zeros(5, [("geom1", int), ("geom2", int)])
    points["geom1"], points["geom2"] = [1, 2, 3, 0, 0], [2, 3, 0, 4, 3]
    robot = np.arange(5) == 1
    assert pushed_by_robot(points, model, robot).tolist() == [True, True, True, False, True]
    assert not pushed_by_robot(points[3:], model, robot).any()
