"""Kernels run without numba where they are compiled, and by numba where they cannot."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from safestage_eval._process import machine_code
from safestage_eval._process.kernel_folder import read_signatures
from safestage_eval._process.machine_code import Compiled
from safestage_eval._process.precompile import compile_kernels
from safestage_eval.geometry import polygon

CHECKOUT = Path(__file__).resolve().parents[2]
FRESH = """
import sys
import numpy as np
from safestage_eval._process.precompile import compile_kernels
from safestage_eval.geometry.polygon import _contains

def inside(dtype):
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype)
    found = np.zeros(2, bool)
    _contains(square, np.array([[0.5, 0.5], [2.0, 0.5]], dtype), found)
    return found.tolist()

compile_kernels()
print(inside(np.float64), "numba" in sys.modules)
print(inside(np.float32), "numba" in sys.modules)
print(inside(np.float64))
import numba
print(numba.njit(lambda x: np.zeros(x).sum() + 1)(3), _contains.dispatcher.signatures != [])
"""


@pytest.fixture(scope="module")
def file():
    """Kernels that this machine has compiled."""
    compile_kernels()
    path = machine_code.file()
    assert path is not None
    return path


def test_numba_is_loaded_only_for_types_that_are_not_compiled(file):
    done = subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "[True, False] False", "[True, False] True", "[True, False]", "1.0 True",
    ]  # fmt: skip


def test_linked_code_computes_as_python_does(file):
    linked = machine_code.link(file)
    (contains,) = linked["safestage_eval.geometry.polygon", "_contains"]
    random = np.random.default_rng(4)
    for _ in range(50):
        angles = np.sort(random.uniform(0, 2 * np.pi, 7))
        outline = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = random.uniform(-1.2, 1.2, (40, 2))
        by_machine, by_python = np.zeros(40, bool), np.zeros(40, bool)
        contains.call(outline, points, by_machine)
        polygon._contains.py_func(outline, points, by_python)
        assert by_machine.tolist() == by_python.tolist()
        assert 0 < by_machine.sum() < 40


def test_arguments_of_the_wrong_kind_are_an_error_and_no_crash(file):
    (contains,) = machine_code.link(file)["safestage_eval.geometry.polygon", "_contains"]
    with pytest.raises(TypeError):
        contains.call(1, 2, 3)


def test_every_kernel_of_the_list_is_in_the_file(file):
    kernels, library = machine_code.read(file)
    listed = {
        (module, name, str(types))
        for module, names in read_signatures().items()
        for name, all_types in names.items()
        for types in all_types
    }
    assert {(kernel.module, kernel.name, str(kernel.types)) for kernel in kernels} == listed
    assert "atan2" in library


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-100], lambda data: data[:-1] + b"?", lambda _: b""]
)
def test_a_damaged_file_is_refused(file, tmp_path, damage):
    path = tmp_path / "damaged.kernels"
    path.write_bytes(damage(file.read_bytes()))
    with pytest.raises((ValueError, KeyError)):
        machine_code.link(path)


def test_numba_loads_kernels_where_a_file_is_damaged(file, tmp_path, monkeypatch):
    (tmp_path / "damaged.kernels").write_bytes(b"{}")
    monkeypatch.setattr(machine_code, "file", lambda: tmp_path / "damaged.kernels")
    monkeypatch.setattr(machine_code, "_HERE", [])
    assert machine_code.load() == {}


def test_code_that_cannot_be_linked_is_not_kept(tmp_path):
    part = tmp_path / "part"
    machine_code.save(part, [Compiled("module", "kernel", [], "symbol", {}, b"no object file")], ())
    machine_code.join([part], tmp_path / "all.kernels")
    assert [*tmp_path.iterdir()] == [part]


def test_parts_are_joined_to_what_one_process_would_have_written(file, tmp_path):
    kernels, library = machine_code.read(file)
    parts = [tmp_path / "first", tmp_path / "second"]
    for part, half in zip(parts, (kernels[::2], kernels[1::2]), strict=True):
        machine_code.save(part, half, library)
    machine_code.join(parts, tmp_path / "joined")
    assert machine_code.read(tmp_path / "joined") == ([*kernels[::2], *kernels[1::2]], library)


def test_a_first_verdict_loads_no_numba(file, tmp_path):
    """Episodes of MCAP and of Parquet: their arrays have dtypes of their own."""
    trace = str(next((CHECKOUT / "traces").glob("fsh_*.mcap")))
    run(["convert", trace, "--to", "parquet", "--out", str(tmp_path / "parquet")])
    for path in (trace, str(tmp_path / "parquet")):
        assert run(["score", path, "--rules", "fsh", "--jobs", "1"]).endswith("numba: False\n")


def run(arguments):
    """Output of a command, and whether numba was loaded."""
    code = (
        "import sys; from safestage_eval.cli import main; sys.argv = ['safestage', *sys.argv[1:]]\n"
        "try: main()\n"
        "finally: print('numba:', 'numba' in sys.modules)\n"
    )
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
