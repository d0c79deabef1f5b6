"""Mistakes of a map file or a flag are named before anything is judged."""

import json

import numpy as np
import pytest
from exports import map_text, write_lerobot
from scenes import Scene
from studio import run

from safestage_eval.episode import Geom

HALF = 0.02
YAW = np.radians(30) / 2


def scene(pad=0.0):
    """A cube that is lifted between two pads, and a mug, on a table; nothing of it is wrong."""
    s = Scene(60, 20.0)
    path = np.column_stack([0 * s.t, 0 * s.t, HALF + 0.1 * np.clip(s.t - 1, 0, 1)])
    turn = (np.cos(YAW), 0, 0, np.sin(YAW))
    s.body("cube", Geom(kind="box", size=(HALF,) * 3), path, turn)
    s.body("mug", Geom(kind="cylinder", size=(0.04, 0.05)), (0.3, 0, 0.05), turn)
    for side, sign in (("left", 1), ("right", -1)):
        across = sign * np.maximum(HALF + 0.01 + pad, 0.1 - 0.1 * s.t)
        at = path + np.outer(across, (-np.sin(2 * YAW), np.cos(2 * YAW), 0))
        s.body(f"{side}_pad", Geom(kind="box", size=(0.01, 0.01, 0.01)), at, turn, kind="object")
    return s.episode(force_source="none")


def written(folder, *, pad=0.0, table=0.0, scale=1.0, shapes="", quaternion="xyzw"):
    """A LeRobot dataset of the scene, and a map file, with what is to be wrong."""
    source, columns = write_lerobot(folder / "in", [scene(pad)])
    if scale != 1.0:
        import pyarrow.parquet as pq

        [file] = source.glob("data/*/*.parquet")
        data = pq.read_table(file)
        for name, places in (
            ("observation.environment_state", range(4)),
            ("observation.twists", ()),
        ):
            rows = np.array(data[name].to_pylist())
            for i in places:
                rows[:, 7 * i : 7 * i + 3] *= scale
            if "twists" in name:
                for i in range(4):
                    rows[:, 6 * i : 6 * i + 3] *= scale
            column = data.schema.get_field_index(name)
            data = data.set_column(column, name, [list(rows.astype(np.float32))])
        pq.write_table(data, file)
    text = map_text(scene(pad))
    for side in ("left", "right"):
        text = text.replace(
            f'[body."{side}_pad"]\nkind = "object"',
            f'[body."{side}_pad"]\nfinger = "{side}"\nkind = "gripper"',
        )
    text += (
        f"[body.table]\nposition = [0, 0, {table}]\n"
        'shapes = [{ kind = "box", size = [0.5, 0.5, 0.02], position = [0, 0, -0.02] }]\n'
    )
    columns = columns.replace("xyzw", quaternion)
    (folder / "map.toml").write_text(text.replace("[every]", columns + shapes + "[every]", 1))
    return source


def take(folder, *more):
    done = run("import", folder / "in", "--to", folder / "data", "--map", folder / "map.toml",
               "-f", "json", *more)  # fmt: skip
    assert done.code == 0, done.err
    notices = json.loads(done.out)["looks_wrong"]
    assert len([line for line in done.err.splitlines() if "looks wrong" in line]) == len(notices)
    return notices


def test_a_sound_import_has_nothing_to_notice(tmp_path):
    written(tmp_path)
    assert take(tmp_path) == []


@pytest.mark.parametrize("off", [0.46, -0.2])
def test_a_table_at_another_height(tmp_path, off):
    written(tmp_path, table=-off)
    [one] = take(tmp_path)
    assert one["cause"] == f"'table' is {100 * abs(off):.1f} cm too {'low' if off > 0 else 'high'}"
    assert one["fix"].startswith("[body.table] position = [0, 0, ")


def test_three_mistakes_of_which_each_hides_the_next_are_three_messages(tmp_path):
    """A mug in centimetres is a tower that all else is in; on a table too low nothing stands."""
    written(tmp_path, pad=0.01, table=-0.46)
    text = (tmp_path / "map.toml").read_text()
    assert "[0.04, 0.05]" in text
    (tmp_path / "map.toml").write_text(text.replace("[0.04, 0.05]", "[4, 5]"))
    notices = take(tmp_path)
    assert len(notices) == 3, notices
    causes = " ".join(f"{one['cause']} {one['fix']}" for one in notices)
    assert "its shapes are in centimetres" in causes
    assert 'with their unit: "4 cm"' in causes
    assert "'table' is 46.0 cm too low" in causes
    assert "_pad] shapes or position in the map file" in causes


def test_centimetres_are_named_and_mended(tmp_path):
    source = written(tmp_path, scale=100.0)
    notices = take(tmp_path)
    assert any('length = "cm"' in one["fix"] for one in notices), notices
    text = (tmp_path / "map.toml").read_text()
    (tmp_path / "map.toml").write_text(text.replace("[source]", '[source]\nlength = "cm"'))
    done = run(
        "import", source, "--to", tmp_path / "again", "--map", tmp_path / "map.toml", "-f", "json"
    )
    assert json.loads(done.out)["looks_wrong"] == []
