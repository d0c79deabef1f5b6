"""Mistakes of a map file or a flag are named before anything is judged."""

import json

import numpy as np
import pytest
from exports import map_text, write_lerobot
from scenes import Scene
from studio import run

from safestage_eval.episode import Geom
from safestage_eval.importers.map_file import load_map
from safestage_eval.importers.map_mistakes import notice, summed
from safestage_eval.importers.map_tables import MapFile

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


def test_quaternions_in_the_other_order(tmp_path):
    written(tmp_path, quaternion="wxyz")
    notices = take(tmp_path)
    assert any("--quaternion xyzw" in one["fix"] for one in notices), notices
    assert all("table" not in one["cause"] for one in notices)


def test_a_finger_pad_a_centimetre_off(tmp_path):
    written(tmp_path, pad=0.01)
    [one] = take(tmp_path)
    assert "_pad' comes nearest, 10 mm away" in one["what"]
    assert "_pad] shapes or position in the map file" in one["fix"]


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


def test_three_mistakes_have_three_messages(tmp_path):
    causes = set()
    for i, wrong in enumerate(({"table": -0.46}, {"quaternion": "wxyz"}, {"pad": 0.01})):
        (tmp_path / str(i)).mkdir()
        written(tmp_path / str(i), **wrong)
        causes.add(take(tmp_path / str(i))[0]["fix"])
    assert len(causes) == 3


def test_sizes_in_centimetres(tmp_path):
    s = scene()
    bodies = tuple(
        b.model_copy(update={"mass": None, "geoms": tuple(
            g.model_copy(update={"size": tuple(100 * x for x in g.size)}) for g in b.geoms)})
        for b in s.header.bodies
    )  # fmt: skip
    object.__setattr__(s, "header", s.header.model_copy(update={"bodies": bodies}))
    shapes = {b.name: {"shapes": [{"kind": "box", "size": [1, 1, 1]}]} for b in bodies}
    [one, *_] = notice(s, MapFile.model_validate({"body": shapes}))
    assert "cm" in one.cause
    assert one.fix.endswith('with their unit: "4 cm"')


def test_equal_notices_of_many_episodes_are_one(tmp_path):
    (tmp_path / "map.toml").write_text("[body.table]\nposition = [0, 0, 0]\n")
    map_ = load_map(tmp_path / "map.toml")
    s = Scene(30, 20.0).fixed("table", (0, 0, -0.46)).box("cube", HALF, (0, 0, HALF))
    s = s.episode(force_source="none")
    [(one, count)] = summed([notice(s, map_)] * 3)
    assert count == 3
    assert str(one).endswith("[AUD204]")


def test_all_gaps_of_a_source_in_one_run(tmp_path):
    written(tmp_path)
    text = (tmp_path / "map.toml").read_text()
    cut = text[: text.index("[every]")].replace('quaternion = "xyzw"', "")
    (tmp_path / "map.toml").write_text(cut)
    done = run("import", tmp_path / "in", "--to", tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == 2
    assert "lacks 2 things" in done.err
    assert "--quaternion" in done.err
    assert "no object has a shape" in done.err
