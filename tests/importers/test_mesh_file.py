"""Mesh files: their points and faces, and no other file that they name."""

import os
import struct

import numpy as np
import pytest
import trimesh

from safestage_eval.errors import InputError
from safestage_eval.importers.mesh_file import SHAPES, read_mesh

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
SIDES = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def opened(monkeypatch):
    """Paths of the files that are opened."""
    import builtins
    import io

    seen, plain = [], io.open

    def noted(file, *args, **kwargs):
        seen.append(os.fspath(file) if not isinstance(file, int) else file)
        return plain(file, *args, **kwargs)

    monkeypatch.setattr(builtins, "open", noted)
    monkeypatch.setattr(io, "open", noted)
    return seen


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply", ".glb", ".off"])
def test_a_box_has_its_corners(tmp_path, ending):
    path = tmp_path / f"box{ending.upper() if ending == '.stl' else ending}"
    data = trimesh.creation.box((0.2, 0.4, 0.6)).export(file_type=ending[1:])
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    vertices, faces = read_mesh(path)
    assert np.unique(np.abs(vertices), axis=0).tolist() == [pytest.approx([0.1, 0.2, 0.3])]
    assert faces.shape == (12, 3)
    assert ending in SHAPES


def test_a_cloud_is_no_mesh(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "a.ply").write_text(head + "end_header\n0 0 0\n1 0 0\n0 1 0\n")
    with pytest.raises(InputError, match="it has no triangles"):
        read_mesh(tmp_path / "a.ply")


def test_materials_are_not_opened(tmp_path, opened):
    (tmp_path / "secret.mtl").write_text("newmtl m\nmap_Kd /etc/hostname\n")
    for name in (tmp_path / "secret.mtl", "secret.mtl", "/dev/zero", "../../../etc/passwd"):
        path = tmp_path / "a.obj"
        path.write_text(f"mtllib {name}\n{CORNERS}usemtl m\n{SIDES}")
        opened.clear()
        assert read_mesh(path)[0].shape == (4, 3)
        assert {str(file) for file in opened} <= {str(path)}


def gltf(path, uri):
    """A triangle whose corners stand in another file."""
    path.write_text(
        f'{{"asset": {{"version": "2.0"}}, "buffers": [{{"uri": "{uri}", "byteLength": 36}}],'
        '"bufferViews": [{"buffer": 0, "byteLength": 36}], "accessors": [{"bufferView": 0,'
        '"componentType": 5126, "count": 3, "type": "VEC3"}], "meshes": [{"primitives":'
        '[{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}'
    )
    return path


def test_buffers_beside_it_are_read(tmp_path):
    (tmp_path / "a.bin").write_bytes(struct.pack("<9f", *range(9)))
    vertices, _ = read_mesh(gltf(tmp_path / "a.gltf", "a.bin"))
    assert sorted(vertices.ravel()) == list(range(9))


@pytest.mark.parametrize(
    "uri", ["../a.bin", "{folder}/a.bin", "a.txt", "zero.bin", "in/a.bin", "pipe.bin"]
)
def test_other_buffers_are_not_opened(tmp_path, opened, uri):
    folder = tmp_path / "meshes"
    (folder / "in").mkdir(parents=True)
    for name in ("../a.bin", "a.txt", "in/a.bin"):
        (folder / name).write_bytes(struct.pack("<9f", *range(9)))
    (folder / "zero.bin").symlink_to("/dev/zero")
    os.mkfifo(folder / "pipe.bin")
    path = gltf(folder / "a.gltf", uri.format(folder=tmp_path))
    opened.clear()
    with pytest.raises(InputError, match="no mesh could be read"):
        read_mesh(path)
    assert {str(file) for file in opened} <= {str(path)}


@pytest.mark.parametrize(
    "name", ["a.zip", "a.json", "a.xaml", "a", "gone.obj", "folder.obj", "pipe.obj"]
)
def test_what_is_no_mesh_file_is_not_opened(tmp_path, name):
    for ending in ("zip", "json", "xaml"):
        (tmp_path / f"a.{ending}").write_text(CORNERS + SIDES)
    (tmp_path / "a").write_text(CORNERS + SIDES)
    (tmp_path / "folder.obj").mkdir()
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(InputError, match="is no mesh file"):
        read_mesh(tmp_path / name)
