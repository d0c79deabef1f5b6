"""Kernels run where nothing can be written: a read-only package, a user without a home."""

import ctypes
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from scenes import Scene

from safestage_eval.formats import save

CHECKOUT = Path(__file__).resolve().parents[2]
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 24, 1, 2
"""Capabilities by which root writes and reads where modes forbid it; see linux/prctl.h, linux/capability.h."""

HOMELESS = "import pwd\ndef unknown(_): raise KeyError('uid not found')\npwd.getpwuid = unknown\n"
"""A user id that the machine does not know: containers are started under such."""


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="capabilities are Linux's")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The package where nobody may write, and one recorded episode."""
    folder = tmp_path_factory.mktemp("installed")
    hide = shutil.ignore_patterns("__pycache__")
    for package in ("safestage_eval", "rules", "schemas"):
        shutil.copytree(CHECKOUT / package, folder / package, ignore=hide)
    scene = Scene(30, 60).fixed("table").box("cup", 0.04, (0, 0, 0.05))
    save(scene.episode(episode_id="cup"), folder / "cup.mcap")
    for path in folder.rglob("*"):
        path.chmod(0o555 if path.is_dir() else 0o444)
    yield folder
    for path in folder.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)


def powerless():
    """Root obeys modes, too."""
    if not os.geteuid():
        for power in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
            ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, power, 0, 0, 0)


def homeless(installed, code, **more):
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": str(installed), **more}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    return subprocess.run(
        [sys.executable, "-c", HOMELESS + code], preexec_fn=powerless, cwd="/", env=environment,
        capture_output=True, text=True, timeout=400, check=False,
    )  # fmt: skip


COMPILE = (
    "from safestage_eval.states import persistence\n"
    "from safestage_eval._process.compiled import KERNELS\n"
    "from safestage_eval._process.kernel_folder import read_signatures\n"
    "from safestage_eval._process.precompile import compile_one\n"
    "m, k = next((m, k) for m, k in read_signatures().items() if '.states.' in m)\n"
    "print(all(compile_one(m, name, t) for name, all in k.items() for t in all))\n"
)


@pytest.mark.parametrize("more", [{}, {"HOME": "/proc/nowhere"}, {"NUMBA_CACHE_DIR": "/proc/none"}])
def test_kernels_are_compiled_where_nothing_can_be_kept(installed, more):
    run = homeless(installed, COMPILE, **more)
    assert (run.returncode, run.stdout, run.stderr) == (0, "True\n", "")


def test_the_home_of_somebody_else_is_no_error(installed, tmp_path):
    """A container that is started as any user, with root's home: nobody may even look into it."""
    theirs = tmp_path / "root"
    theirs.mkdir(mode=0o000)
    run = homeless(installed, COMPILE, HOME=str(theirs))
    assert (run.returncode, run.stdout, run.stderr) == (0, "True\n", "")


@pytest.mark.slow
def test_a_verdict_comes_and_it_is_said_once(installed):
    code = (
        "import sys; sys.argv = ['safestage', 'score', %r, '--rules', 'fsh', '-f', 'json', '--assign', "
        "'FSH101', '--role', 'target=cup', '--assigned']\n"
        "from safestage_eval.cli import main; main()\n"
    )
    run = homeless(installed, code % str(installed / "cup.mcap"))
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["episodes"]
    assert run.stderr.count("compiled anew by each process") == 1
    assert "Traceback" not in run.stderr
