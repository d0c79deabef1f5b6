"""A stranger's MuJoCo model: meshes alone are opened, and nothing else is let in."""

import pytest

from safestage_eval.errors import InputError
from simulate.importers.model_file import load_model

pytestmark = pytest.mark.simulate
MODEL = """<mujoco><asset>{asset}</asset><worldbody><body name="b"><geom size=".1"/>{body}</body>
</worldbody>{more}</mujoco>"""


def model(asset="", body="", more=""):
    return MODEL.format(asset=asset, body=body, more=more)


@pytest.mark.parametrize("name", ["secret.txt", "id_ed25519", "secret"])
def test_files_without_the_ending_of_a_mesh_are_not_opened(tmp_path, name):
    (tmp_path / name).write_text("SECRET")
    mesh = f'<mesh name="m" file="{tmp_path / name}"/>'
    loaded = load_model(model(mesh, '<geom type="mesh" mesh="m"/>'), "x")
    assert loaded.lost == (str(tmp_path / name),)
    assert not loaded.assets
    assert not loaded.model.ngeom  # not with a part of its shapes


@pytest.mark.parametrize(
    "more", ['<include file="{}"/>', '<asset><model name="o" file="{}"/></asset>']
)
def test_no_model_includes_another(tmp_path, more):
    other = tmp_path / "other.xml"
    other.write_text("<mujoco/>")
    with pytest.raises(InputError, match="other"):
        load_model(model(more=more.format(other)), "x")


def test_entities_are_not_resolved_from_files(tmp_path):
    (tmp_path / "secret").write_text("SECRET")
    text = f'<!DOCTYPE x [<!ENTITY s SYSTEM "file://{tmp_path}/secret">]>' + model(body="&s;")
    with pytest.raises(InputError) as caught:
        load_model(text, "x")
    assert "SECRET" not in str(caught.value)
