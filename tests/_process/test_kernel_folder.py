"""Machine code is found again where it runs, and nowhere else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.registry import cpu_target

from safestage_eval._process import kernel_folder

STAMP = "from safestage_eval._process.kernel_folder import stamp; print(stamp())"


def stamp(**more):
    environment = {**os.environ, **more}
    command = [sys.executable, "-c", STAMP]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


def test_the_processor_is_the_one_that_numba_compiles_for():
    assert kernel_folder.processor() == cpu_target.target_context.codegen().magic_tuple()


def test_code_for_any_processor_is_found_by_every_one(monkeypatch):
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    assert kernel_folder.processor()[1:] == ("generic", "")


@pytest.mark.parametrize("more", [{"NUMBA_CPU_NAME": "generic"}, {"NUMBA_BOUNDSCHECK": "1"}])
def test_code_compiled_otherwise_is_kept_apart(more):
    assert stamp(**more) not in {stamp(), ""}


def test_a_chosen_folder_keeps_it_under_the_same_name(tmp_path):
    assert stamp(NUMBA_CACHE_DIR=str(tmp_path)) == str(tmp_path / Path(stamp()).name)


def test_a_package_is_found_without_being_imported():
    assert (kernel_folder.package_folder("numba") / "_version.py").is_file()
    with pytest.raises(ImportError, match="no package 'not_there'"):
        kernel_folder.package_folder("not_there")
