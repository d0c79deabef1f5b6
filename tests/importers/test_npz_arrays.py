"""Strangers' NumPy archives take no more memory than the limit allows, and run nothing."""

import io
import re
import tracemalloc
import zipfile

import numpy as np
import pytest

from safestage_eval.errors import InputError
from safestage_eval.importers.npz_arrays import npy_array, npz_arrays, npz_names

ZEROS = 40 << 20
"""Numbers of a bomb: 320 MiB, of which 320 kB are stored."""


def packed(path, *, compress=True, **members):
    """An archive of any bytes as members."""
    kind = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return path


def header(shape, kind="<f8"):
    """The first bytes of an array of any shape."""
    out = io.BytesIO()
    about = {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, about)
    return out.getvalue()


def test_what_is_asked_for_and_there_is_read(tmp_path):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, states=np.arange(6.0).reshape(2, 3), env="Lift", other=np.ones(3))
    assert npz_names(path) == {"states", "env", "other"}
    found = npz_arrays(path, ("states", "env", "gone"))
    assert list(found) == ["states", "env"]
    assert found["states"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert str(found["env"]) == "Lift"


def test_a_bomb_is_refused_before_there_is_room_for_it(tmp_path):
    path = packed(tmp_path / "a.npz", states=header((ZEROS,)) + bytes(8 * ZEROS), small=header(()))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"would become 33\d,\d{3},\d{3}.*--limits decoded="):
            npz_arrays(path, ("states",))
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


def test_the_limit_can_be_raised_and_what_is_not_asked_for_does_not_count(tmp_path, monkeypatch):
    path = packed(tmp_path / "a.npz", states=header((8 << 10,)) + bytes(64 << 10), b=header((0,)))
    monkeypatch.setenv("SAFESTAGE_LIMITS", "decoded=10")
    with pytest.raises(InputError, match="would become"):
        npz_arrays(path, ("states", "b"))
    assert npz_arrays(path, ("b",))["b"].shape == (0,)
    monkeypatch.setenv("SAFESTAGE_LIMITS", "decoded=1MB")
    assert npz_arrays(path, ("states",))["states"].shape == (8 << 10,)


@pytest.mark.parametrize(
    "member",
    [header((10**15,)) + bytes(64), header((1 << 28,)) + bytes(64), header((-1,)), b"", b"\x93NUMPY",
     header((2,), "|O") + b"\x80\x04."],
    ids=["petabytes", "2 GiB", "negative", "empty", "headless", "objects"],
)  # fmt: skip
def test_arrays_hold_what_they_claim(tmp_path, member):
    path = packed(tmp_path / "a.npz", states=member)
    with pytest.raises(InputError, match=r"a\.npz: cannot be read"):
        npz_arrays(path, ("states",))
    (tmp_path / "a.npy").write_bytes(member)
    with pytest.raises(InputError, match=r"a\.npy: cannot be read"):
        npy_array(tmp_path / "a.npy")


def test_a_member_that_holds_more_than_the_archive_says(tmp_path):
    """The size in the directory is what is compared: no more than that is unpacked."""
    data = header((1 << 20,)) + bytes(8 << 20)
    path = packed(tmp_path / "a.npz", states=data)
    whole = path.read_bytes()
    size = len(data).to_bytes(4, "little")
    path.write_bytes(whole.replace(size, (1000).to_bytes(4, "little")))
    with pytest.raises(InputError, match=re.escape("cannot be read")):
        npz_arrays(path, ("states",))


@pytest.mark.parametrize(
    "data", [b"", b"PK\x03\x04", b"\x93NUMPY\x01\x00", b"text", header((1,)) + bytes(8)]
)
def test_what_is_no_archive_is_reported(tmp_path, data):
    (tmp_path / "a.npz").write_bytes(data)
    assert npz_names(tmp_path / "a.npz") == frozenset()
    with pytest.raises(InputError, match="cannot be read"):
        npz_arrays(tmp_path / "a.npz", ("states",))
    with pytest.raises(InputError, match="cannot be read"):
        npz_arrays(tmp_path / "gone.npz", ("states",))
