"""Distributions: an sdist, the wheel built from it, which scores traces by itself, and the image of it."""

import email
import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from importlib import metadata as installed

import pytest
from packaging.requirements import Requirement

pytestmark = pytest.mark.slow

LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")


@pytest.fixture(scope="module")
def dist(checkout, tmp_path_factory):
    """Folder with the sdist, and the wheel built from it."""
    out = tmp_path_factory.mktemp("dist")
    done = subprocess.run(
        [sys.executable, "-m", "build", "--outdir", str(out), str(checkout)],
        cwd=out, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return out


@pytest.fixture(scope="module")
def metadata(dist):
    (wheel,) = dist.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = [n for n in archive.namelist() if n.endswith(".dist-info/METADATA")]
        return email.message_from_bytes(archive.read(name))


def test_the_index_can_show_it(dist):
    pytest.importorskip("twine")
    done = subprocess.run(
        [sys.executable, "-m", "twine", "check", "--strict", *map(str, dist.iterdir())],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_links_of_its_page_need_no_repository_around_them(metadata, checkout):
    page = metadata.get_payload(decode=True).decode()
    links = [one or other for one, other in LINK.findall(page)]
    assert len(links) > 10
    assert [link for link in links if not link.startswith(("https://", "#"))] == []
    own = "https://github.com/safestage/safestage/blob/main/"
    pictures = "https://raw.githubusercontent.com/safestage/safestage/main/"
    lead = [link.removeprefix(start).partition("#")[0] for start in (own, pictures)
            for link in links if link.startswith(start)]  # fmt: skip
    assert len(lead) > 10
    assert [path for path in lead if not (checkout / path).exists()] == []


def test_it_says_what_it_is(metadata):
    assert metadata["License-Expression"] == "Apache-2.0"
    assert metadata["Description-Content-Type"] == "text/markdown"
    urls = dict(value.split(", ", 1) for value in metadata.get_all("Project-URL"))
    assert {"Homepage", "Documentation", "Changelog", "Issues"} <= urls.keys()
    pythons = {
        c.rpartition(" ")[2] for c in metadata.get_all("Classifier") if re.search(r":: 3\.\d+$", c)
    }
    assert pythons == {"3.11", "3.12", "3.13", "3.14"}
    assert metadata["Requires-Python"] == ">=3.11"


def test_the_sdist_has_no_recordings_and_all_that_a_build_needs(dist):
    (sdist,) = dist.glob("*.tar.gz")
    assert sdist.stat().st_size < 15e6  # the checkpoint of a policy takes 7
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "README.md", "LICENSE", "safestage_eval/py.typed"} <= names
    assert not [
        name for name in names if name.startswith(("traces/", "traces_learned/", "recorder/"))
    ]


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
            here = installed.distribution(need.name)
            assert need.specifier.contains(here.version, prereleases=True), line
            found |= {need.name: here, **needed(here, ("", *need.extras))}
    return found


def lend(site, found):
    """Link what a distribution brings into another environment, and nothing else."""
    for top in {file.parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
        if not (site / top).exists():
            (site / top).symlink_to(found.locate_file(top))


def test_everything_travels_in_the_wheel(dist, checkout):
    (wheel,) = dist.glob("*.whl")
    inside = {*zipfile.ZipFile(wheel).namelist()}
    for folder in ("rules", "schemas"):
        files = [path for path in (checkout / folder).rglob("*") if path.is_file()]
        assert files
        below = {path.relative_to(checkout).as_posix() for path in files}
        assert {f"safestage_eval/_builtin/{path}" for path in below} <= inside
    tasks = {f"simulate/tasks/{path.name}" for path in (checkout / "simulate/tasks").glob("*.toml")}
    assert tasks | {"simulate/catalogue/food.toml", "safestage_eval/py.typed"} <= inside
    assert not [name for name in inside if name.startswith(("tests/", "traces/"))]


def test_the_installed_wheel_scores_a_trace(dist, trace, tmp_path):
    """With what it says that it needs; ``make demo`` has the same fetched."""
    (wheel,) = dist.glob("*.whl")
    home = tmp_path / "venv"
    venv.create(home)
    python = home / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python)
    run(*pip, "install", "--quiet", "--no-deps", wheel, cwd=tmp_path)
    (site,) = home.glob("lib/python*/site-packages")
    (ours,) = installed.distributions(path=[str(site)])
    for found in needed(ours).values():
        lend(site, found)
    here = "import safestage_eval; print(safestage_eval.__file__)"
    assert str(home.resolve()) in run(python, "-c", here, cwd=tmp_path)
    find = "from importlib.util import find_spec; print(find_spec('mujoco'))"
    assert run(python, "-c", find, cwd=tmp_path).strip() == "None"
    assert run(home / "bin" / "safestage-score", trace, "--rules", "fsh", cwd=tmp_path).strip()
    assert "score" in run(home / "bin" / "safestage", "--help", cwd=tmp_path)


def test_the_image_is_made_of_the_wheel_and_starts_its_command(checkout):
    steps = re.sub(r"\\\n\s*", " ", (checkout / "Dockerfile").read_text("utf-8")).splitlines()
    (entry,) = (json.loads(line.split(None, 1)[1]) for line in steps if line.startswith("ENTRY"))
    project = tomllib.loads((checkout / "pyproject.toml").read_text("utf-8"))["project"]
    assert entry[0] in project["scripts"]
    ignored = (checkout / ".dockerignore").read_text("utf-8").split()
    assert {"traces", ".git", "tests", "recorder"} <= {*ignored}
    assert not {"safestage_eval", "rules", "README.md", "pyproject.toml"} & {*ignored}
