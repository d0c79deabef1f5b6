"""All kernels are compiled once per machine, by one process at a time, before they are called."""

import importlib
import inspect
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from safestage_eval._process import precompile
from safestage_eval._process.kernel_folder import read_signatures
from safestage_eval._process.kernel_types import from_json, to_json
from safestage_eval.cli.shared_options import prepare_kernels

CHECKOUT = Path(__file__).resolve().parents[2]
ONE_ROOM = """
import json, sys
from pathlib import Path
from safestage_eval._process import kernel_folder, precompile
kernel_folder.SIGNATURES = Path(sys.argv[1])
compiling = precompile._compile
def counted(*args):
    print("compiles", flush=True)
    return compiling(*args)
precompile._compile = counted
precompile.compile_kernels()
print("done" if kernel_folder.stamp().exists() else "not done")
"""


def start(tmp_path, code, *arguments):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    environment["PYTHONPATH"] = str(CHECKOUT)
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)


@pytest.fixture
def small(tmp_path):
    """A list with the kernels of one small room."""
    path = tmp_path / "signatures.json"
    states = {m: k for m, k in read_signatures().items() if m.startswith("safestage_eval.states.")}
    assert states
    path.write_text(json.dumps(states), "utf-8")
    return path


def test_types_survive_json():
    for kernels in read_signatures().values():
        for all_types in kernels.values():
            for types in all_types:
                assert [to_json(from_json(kind)) for kind in types] == types


@pytest.mark.slow
def test_every_kernel_that_the_goldens_call_is_listed():
    script = CHECKOUT / "benchmarks" / "kernel_signatures.py"
    done = subprocess.run(
        [sys.executable, script, CHECKOUT / "traces"],
        capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": str(CHECKOUT)},
    )  # fmt: skip
    assert "; 0 signatures are not listed" in done.stdout, done.stdout


@pytest.mark.slow
def test_of_processes_that_start_together_one_compiles(tmp_path, small):
    together = [start(tmp_path, ONE_ROOM, small) for _ in range(3)]
    said = [process.communicate(timeout=300)[0].split() for process in together]
    assert sorted(said) == [["compiles", "done"], ["done"], ["done"]]
    kernels = sum(map(len, json.loads(small.read_text("utf-8")).values()))
    assert len([*(tmp_path / "kernels").rglob("*.nbi")]) >= kernels
    later = start(tmp_path, ONE_ROOM, small)
    assert later.communicate(timeout=300)[0].split() == ["done"]


@pytest.mark.slow
def test_a_compiler_that_dies_leaves_the_work_to_the_next(tmp_path, small):
    dying = ONE_ROOM.replace(
        "precompile.compile_kernels()",
        "precompile.PROGRAM = 'import os, signal; os.kill(os.getpid(), signal.SIGKILL)'\n"
        "precompile.compile_kernels()",
    )
    assert start(tmp_path, dying, small).communicate(timeout=300)[0].split() == [
        "compiles", "not", "done",
    ]  # fmt: skip
    after = start(tmp_path, ONE_ROOM, small).communicate(timeout=300)[0].split()
    assert after == ["compiles", "done"]


def test_a_list_that_is_out_of_date_is_no_error(monkeypatch):
    assert not precompile.compile_one("safestage_eval.states.limits", "gone", [])
    assert not precompile.compile_one("safestage_eval.gone", "kernel", [])
    gone = ["named", "safestage_eval.states.limits:Gone", ["int64"]]
    assert not precompile.compile_one("safestage_eval.states.limits", "_limit_margin", [gone])


def test_the_first_compile_is_announced_once_without_a_terminal(monkeypatch, capsys):
    def compiled(tell):
        for done in range(3):
            tell(done, 2)

    monkeypatch.setattr(precompile, "compile_kernels", compiled)
    prepare_kernels()
    assert capsys.readouterr().err == "compiling 2 numerical kernels, once per machine …\n"


def test_each_listed_signature_has_as_many_types_as_its_kernel_has_arguments():
    for module, kernels in read_signatures().items():
        for name, signatures in kernels.items():
            kernel = getattr(importlib.import_module(module), name)
            count = len(inspect.signature(kernel.py_func).parameters)
            assert {len(signature) for signature in signatures} == {count}, name
