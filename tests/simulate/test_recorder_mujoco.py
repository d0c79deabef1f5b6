"""Contacts computed by the MuJoCo of another interpreter are those of that MuJoCo."""

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from foreign_demos import demo_file, said, scene, settled

from safestage_eval.evidence.measure import Signals
from safestage_eval.importers import Account, MapFile, Settings
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.map_tables import BodyTable
from simulate.importers.mujoco import MujocoStates

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
        assert np.allclose(a, b, atol=1e-3 if "force" in column else 1e-6, equal_nan=True), column
    far = [b.name for b in here.header.bodies].index("far")
    rows = (here.contacts.body2 == far) & (here.contacts.frame == 4)
    assert here.contacts.force[rows, 2].sum() == pytest.approx(0.3 * 9.81, rel=1e-3)


PRESS = """
<body name="robot0_link1" pos="0 0 0.3"><joint name="j" axis="0 1 0" damping="1"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 -0.24" size="0.02" mass="2"/></body>
<body name="desk" pos="0.3 0 0.02"><geom type="box" size=".05 .05 .01"/></body>
<body name="under" pos="0.3 0 0.05"><freejoint/><geom type="box" size=".02 .02 .02" mass="0.1"/></body>
"""


def pressing(rows=60, steps=25, *, fixed=False):
    """States of an arm that goes up and down on a box with commands that nobody stores.

    ``fixed``: the box is, and each row has a command of its own.

    Returns:
        The model, its (rows, 1 + nq + nv) states, (rows,) N that the arm presses with, and the (rows, 1) commands.
    """
    text = scene(bodies=PRESS.replace("<freejoint/>", "") if fixed else PRESS, rest=MOTOR)
    model = mujoco.MjModel.from_xml_string(text)
    data, force = mujoco.MjData(model), np.zeros(6)
    states, truth, commands = [], [], []
    ids = {model.body(name).id for name in ("robot0_link1", "under")}
    for step in range(rows * steps):
        time = (step - step % steps if fixed else step) * model.opt.timestep
        data.ctrl[:] = 4 * np.sin(1.5 * time) + (12 if time > 1.5 else -8 if time > 1.2 else 0)
        mujoco.mj_forward(model, data)
        if step % steps == 0:
            states.append(np.concatenate([[data.time], data.qpos, data.qvel]))
            total = 0.0
            for i in range(data.ncon):
                geoms = data.contact[i].geom
                if set(model.geom_bodyid[geoms].tolist()) == ids:
                    mujoco.mj_contactForce(model, data, i, force)
                    total += force[0]
            truth.append(total)
            commands.append(data.ctrl.copy())
        mujoco.mj_step(model, data)
    return text, np.array(states), np.array(truth), np.array(commands)


def test_what_a_robot_presses_with_is_right_or_unknown_without_its_commands(tmp_path):
    text, states, truth, _ = pressing()
    about = {"mujoco_version": mujoco.__version__}
    episode, account = read(demo_file(tmp_path / "d.hdf5", text, states, about=about))
    assert "not stored" in said(account, "forces on and by the robot").how
    signals = Signals(episode)
    found = signals.get("contact_force", ["robot0_link1", "under"])
    known = found.lower == found.upper
    assert truth.max() > 10
    assert (truth == 0).any()  # it lifts off, and strikes again
    assert known[truth > 0.1].mean() > 0.6
    assert not known.all()
    assert np.abs(found.lower - truth)[known].max() < 0.05
    assert (found.lower <= truth + 0.05).all()  # what is certain of the others
    assert (found.lower >= 0.05)[~known].any()


def test_stored_commands_give_the_forces_they_cause(tmp_path):
    text, states, truth, ctrl = pressing()
    (tmp_path / "s.xml").write_text(text)
    for rows in (slice(None), slice(0, 1)):  # one row is enough
        time, qpos, qvel = np.split(states[rows], (1, 9), axis=1)
        np.savez(tmp_path / "s.npz", time=time[:, 0], qpos=qpos, qvel=qvel, ctrl=ctrl[rows],
                 mujoco_version=mujoco.__version__)  # fmt: skip
        episode, account = read(tmp_path / "s.npz")
        assert not [remark for remark in account if "by the robot" in remark.what]
        found = Signals(episode).get("contact_force", ["robot0_link1", "under"])
        assert found.lower == pytest.approx(truth[rows], abs=1e-3)
        assert found.upper == pytest.approx(truth[rows], abs=1e-3)


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
