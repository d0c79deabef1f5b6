"""Contacts are gathered as MuJoCo itself tells them one by one, with both kinds of friction cone."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from simulate.world.contact_reader import ContactReader

pytestmark = pytest.mark.simulate

BALLS = "".join(
    f'<body pos="{0.021 * (i % 6)} {0.021 * (i // 6)} {0.03 + 0.002 * i}"><freejoint/>'
    f'<geom size="0.012" condim="{(1, 3, 4, 6)[i % 4]}" mass="0.1"/></body>'
    for i in range(24)
)
PILE = f"""<mujoco><option cone="{{cone}}" timestep="0.002"/><worldbody>
<geom type="plane" size="1 1 1" condim="3"/>{BALLS}</worldbody></mujoco>"""


def told(
    model: mujoco.MjModel, data: mujoco.MjData
) -> dict[tuple[int, int], list[tuple[np.ndarray, ...]]]:
    """Pair of geoms → normal force, and position, normal, force, depth of each point, by ``mj_contactForce``."""
    result: dict[tuple[int, int], list[tuple[np.ndarray, ...]]] = {}
    for i in range(data.ncon):
        contact, local = data.contact[i], np.zeros(6)
        mujoco.mj_contactForce(model, data, i, local)
        if contact.efc_address < 0 or not (local[0] > 0 or contact.dist <= 0):
            continue
        frame = contact.frame.reshape(3, 3)
        key = (int(contact.geom1), int(contact.geom2))
        point = (local[0], contact.pos.copy(), frame[0].copy(), frame.T @ local[:3], -contact.dist)
        result.setdefault(key, []).append(point)
    return result


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_as_mujoco_tells_them(cone: str) -> None:
    model = mujoco.MjModel.from_xml_string(PILE.format(cone=cone))
    data = mujoco.MjData(model)
    reader = ContactReader(model, data, np.arange(model.ngeom))
    rested = 0
    for frame in range(80):
        peaks: dict[tuple[int, int], float] = {}
        for substep in range(3):
            mujoco.mj_step(model, data)
            now = told(model, data)
            for key, points in now.items():  # here each body has one geom
                peaks[key] = max(peaks.get(key, 0.0), sum(point[0] for point in points))
            if substep < 2:
                reader.between()
        found = reader.frame()
        pairs = [(int(point["geom1"]), int(point["geom2"])) for point in found]
        assert set(pairs) == set(peaks), f"frame {frame}"
        for key, points in now.items():
            own = found[[pair == key for pair in pairs]]
            assert len(own) == len(points)
            for point, (_, position, normal, force, depth) in zip(own, points, strict=True):
                assert point["position"] == pytest.approx(position, abs=1e-6)
                assert point["normal"] == pytest.approx(normal, abs=1e-6)
                assert point["force"] == pytest.approx(force, rel=1e-5, abs=1e-6)
                assert point["depth"] == pytest.approx(depth, abs=1e-7)
        for point, pair in zip(found, pairs, strict=True):
            assert point["peak_force"] == pytest.approx(peaks[pair], rel=1e-5, abs=1e-6)
            if pair not in now:
                assert not point["force"].any(), "it no longer touches"
        rested = len(now)
    assert rested > 20, "nothing came to rest on anything"
    assert len(reader.frame()) == 0 or data.ncon
