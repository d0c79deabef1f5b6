"""The wheel alone, without the simulator, away from the checkout."""

import os
import subprocess
import sys
import venv
import zipfile
from importlib import metadata

import pytest
from packaging.requirements import Requirement

pytestmark = pytest.mark.slow


def run(*command, cwd):
    away = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, cwd=cwd, env=away, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


def needed(by, extras=("",)):
    """Name → distribution here, of all that one needs by what it says itself."""
    found = {}
    for line in by.requires or ():
        need = Requirement(line)
        if need.marker is None or any(need.marker.evaluate({"extra": e}) for e in extras):
            here = metadata.distribution(need.name)
            assert need.specifier.contains(here.version, prereleases=True), line
            found |= {need.name: here, **needed(here, ("", *need.extras))}
    return found


def lend(site, found):
    """Link what a distribution brings into another environment, and nothing else."""
    for top in {file.parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
        if not (site / top).exists():
            (site / top).symlink_to(found.locate_file(top))


@pytest.fixture(scope="module")
def wheel(checkout, tmp_path_factory):
    out = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--wheel", "--outdir", out, checkout, cwd=out)
    (file,) = out.glob("*.whl")
    return file


def test_everything_travels_in_the_wheel(wheel, checkout):
    inside = {*zipfile.ZipFile(wheel).namelist()}
    for folder in ("rules", "schemas"):
        files = [path for path in (checkout / folder).rglob("*") if path.is_file()]
        assert files
        below = {path.relative_to(checkout).as_posix() for path in files}
        assert {f"safestage_eval/_builtin/{path}" for path in below} <= inside
    tasks = {f"simulate/tasks/{path.name}" for path in (checkout / "simulate/tasks").glob("*.toml")}
    assert tasks | {"simulate/catalogue/food.toml", "safestage_eval/py.typed"} <= inside
    assert not [name for name in inside if name.startswith(("tests/", "traces/"))]


def test_the_installed_wheel_scores_a_trace(wheel, trace, tmp_path):
    """With what it says that it needs; ``make demo`` has the same fetched."""
    home = tmp_path / "venv"
    venv.create(home)
    python = home / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python)
    run(*pip, "install", "--quiet", "--no-deps", wheel, cwd=tmp_path)
    (site,) = home.glob("lib/python*/site-packages")
    (ours,) = metadata.distributions(path=[str(site)])
    for found in needed(ours).values():
        lend(site, found)
    here = "import safestage_eval; print(safestage_eval.__file__)"
    assert str(home.resolve()) in run(python, "-c", here, cwd=tmp_path)
    find = "from importlib.util import find_spec; print(find_spec('mujoco'))"
    assert run(python, "-c", find, cwd=tmp_path).strip() == "None"
    assert run(home / "bin" / "safestage-score", trace, "--rules", "fsh", cwd=tmp_path).strip()
    assert "score" in run(home / "bin" / "safestage", "--help", cwd=tmp_path)
