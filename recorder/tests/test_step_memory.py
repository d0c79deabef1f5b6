"""Values read from memory equal MuJoCo's attributes."""

import ctypes

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

from safestage_record import step_memory  # noqa: E402
from safestage_record.record_error import RecordError  # noqa: E402
from safestage_record.step_memory import StepMemory  # noqa: E402

SCENE = """
<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .06"><freejoint/><geom type="box" size=".03 .02 .05"/></body>
  <body pos="0 0 .3"><freejoint/><geom type="capsule" size=".02 .05"/></body>
  <body pos=".3 0 .2"><joint type="hinge" axis="0 1 0" range="-.1 .1" limited="true"/>
    <geom size=".05" pos=".1 0 0" mass="1"/></body>
</worldbody></mujoco>
"""


def scene():
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, scratch = mujoco.MjData(model), mujoco.MjData(model)
    return model, data, scratch


def field(memory, copied, name, shape):
    """(C, width) of a field of a copy."""
    window, offset, kind = memory.fields[name]
    begin = step_memory.HEAD.size + shape[0] * sum(memory.windows[:window]) + offset
    strides = memory.windows[window], kind.itemsize
    return np.ndarray(shape, kind, copied, begin, strides)


@pytest.mark.parametrize("found", [True, False])
def test_numbers_contacts_and_forces_are_those_of_mujoco_in_every_step(monkeypatch, found):
    """Also where the numbers are not found in memory."""
    model, data, scratch = scene()
    if not found:
        monkeypatch.setattr(step_memory, "_offsets", {})
        monkeypatch.setattr(step_memory, "_FARTHEST", 0)
    memory = StepMemory(data, scratch)
    assert isinstance(memory.time, ctypes.c_double) == found
    counts = set()
    for _ in range(400):
        mujoco.mj_step(model, data)
        assert memory.time.value == data.time
        copied = memory.copier()()
        assert bool(copied) == bool(data.ncon)
        if data.ncon:
            assert step_memory.HEAD.unpack_from(copied) == (data.ncon, data.nefc)
            forces = data.efc_force.tobytes()
            assert copied[len(copied) - len(forces) :] == forces
            for name in ("dist", "pos", "dim", "efc_address", "frame"):
                expected = getattr(data.contact, name).reshape(data.ncon, -1)
                assert np.array_equal(field(memory, copied, name, expected.shape), expected), name
            pairs = [(data.contact[i].geom1, data.contact[i].geom2) for i in range(data.ncon)]
            assert np.array_equal(field(memory, copied, "geom", (data.ncon, 2)), pairs)
        memory.check()
        counts.add(data.ncon)
    assert len(counts) > 2


def test_a_number_that_is_elsewhere_is_an_error():
    model, data, scratch = scene()
    memory = StepMemory(data, scratch)
    mujoco.mj_step(model, data, 200)
    memory.time = type(memory.time)(1.0)
    with pytest.raises(RecordError, match="moved"):
        memory.check()
