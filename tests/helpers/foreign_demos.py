"""Small files in the layouts of other simulators, and what they are put into."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import mujoco
import numpy as np

from safestage_eval.episode import Episode, Remark
from safestage_eval.importers import Account, MapFile, Settings
from simulate.importers.mujoco import MujocoStates

FOREIGN = Path(__file__).parents[1] / "simulate" / "foreign"
ASSETS = FOREIGN / "robosuite" / "assets"

TABLE_AND_CUBE = """
<mujoco>
  <option timestep="0.002" cone="{cone}"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="cube" pos="0 0 0.02">
      <freejoint/>
      <geom type="box" size="0.02 0.02 0.02" mass="{mass}" {more}/>
    </body>
    {bodies}
  </worldbody>
  {rest}
</mujoco>
"""


def scene(mass: float = 0.1, *, cone: str = "elliptic", more: str = "", bodies: str = "",
          rest: str = "") -> str:  # fmt: skip
    """MJCF of a cube of 4 cm on a floor."""
    return TABLE_AND_CUBE.format(mass=mass, cone=cone, more=more, bodies=bodies, rest=rest)


def settled(text: str, rows: int = 5, control_dt: float = 0.05) -> np.ndarray:
    """(rows, 1 + nq + nv) states of a scene after a second of rest."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    out = []
    for row in range(rows):
        steps = round((1.0 if row == 0 else control_dt) / model.opt.timestep)
        mujoco.mj_step(model, data, steps)
        out.append(np.concatenate([[data.time], data.qpos, data.qvel]))
    return np.array(out)


def demo_file(path: Path, model: str | None, states: Any, *, name: str = "demo_1",
              about: dict[str, Any] | None = None, **columns: Any) -> Path:  # fmt: skip
    """An HDF5 file with one demonstration; ``about``: attributes of ``data``."""
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs.update(about or {})
        group = data.create_group(name)
        if states is not None:
            group.create_dataset("states", data=states)
        if model is not None:
            group.attrs["model_file"] = model
        for key, value in columns.items():
            group.create_dataset(key, data=value)
    return path


def imported(path: Path, *, map_: MapFile | None = None, assets: tuple[Path, ...] = (ASSETS,),
             dt: float | None = None) -> tuple[Episode, tuple[Remark, ...]]:  # fmt: skip
    """The first episode of a file or folder, and its account."""
    importer = MujocoStates(path, Settings(map=map_ or MapFile(), assets=assets, dt=dt))
    account = Account()
    try:
        return importer.read(importer.episodes()[0], account), account.remarks
    finally:
        importer.close()


def said(remarks: tuple[Remark, ...], what: str) -> Remark:
    """The remark on something."""
    return next(remark for remark in remarks if what in remark.what)
