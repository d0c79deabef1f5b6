"""The steps of the Dockerfile, run in a fresh folder and a fresh environment in place of an image."""

import json
import os
import re
import shutil
import site
import subprocess
import venv
from fnmatch import fnmatch
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

FOLDERS = ("/src", "/dist", "/data", "/usr/local/share/safestage")
"""Those that the steps name: in the test they lie below a folder of its own."""


def steps(text):
    """(instruction, argument) of each line, continued ones joined."""
    joined = re.sub(r"\\\n\s*", " ", re.sub(r"^#.*\n", "", text, flags=re.MULTILINE))
    return [tuple(line.split(None, 1)) for line in joined.splitlines() if line.strip()]


class Image:
    """A folder for a root and an environment for the base image's Python."""

    def __init__(self, root, checkout):
        self.root, self.checkout = root, checkout
        self.env = {name: value for name, value in os.environ.items()
                    if not name.startswith(("NUMBA_", "PYTHON"))}  # fmt: skip
        self.begin()

    def begin(self):
        """``FROM``: a stage with an environment of its own."""
        home = self.root / f"python-{len(list(self.root.glob('python-*')))}"
        venv.create(home, with_pip=True)
        (packages,) = home.glob("lib/python*/site-packages")
        # what the wheel needs is here already, so that nothing is fetched again
        (packages / "here.pth").write_text("\n".join(site.getsitepackages()), "utf-8")
        self.env |= {"PATH": f"{home / 'bin'}:{os.environ['PATH']}", "VIRTUAL_ENV": str(home)}
        self.folder, self.home = self.root, home

    def placed(self, text):
        for folder in FOLDERS:
            text = re.sub(rf"(?<![\w.]){folder}\b", str(self.root) + folder, text)
        return text

    def do(self, instruction, argument):
        argument = self.placed(argument)
        match instruction:
            case "FROM":
                self.begin()
            case "WORKDIR":
                self.folder = Path(argument)
                self.folder.mkdir(parents=True, exist_ok=True)
            case "ENV":
                for name, quoted, plain in re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', argument):
                    self.env[name] = quoted or plain
            case "COPY" if argument == ". .":
                self.copy_context()
            case "COPY":
                assert argument.startswith("--from=")  # the folder is there already
            case "RUN":
                done = self.run(["sh", "-ec", argument])
                assert done.returncode == 0, f"{argument}\n{done.stdout}\n{done.stderr}"
            case "ENTRYPOINT":
                self.entry = json.loads(argument)
            case "CMD":
                self.command = json.loads(argument)
            case _:
                raise AssertionError(instruction)

    def copy_context(self):
        """Files of the build context: tracked files that ``.dockerignore`` leaves."""
        ignored = (self.checkout / ".dockerignore").read_text("utf-8").split()
        listed = subprocess.run(
            ["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=self.checkout,
            capture_output=True, text=True, check=True,
        ).stdout.splitlines()  # fmt: skip
        for name in listed:
            if any(fnmatch(name.split("/")[0], pattern) for pattern in ignored):
                continue
            target = self.folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(self.checkout / name, target)

    def run(self, command, **more):
        return subprocess.run(
            command, cwd=self.folder, env={**self.env, **more}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip


@pytest.fixture(scope="module")
def image(checkout, tmp_path_factory):
    image = Image(tmp_path_factory.mktemp("image"), checkout)
    for step in steps((checkout / "Dockerfile").read_text("utf-8")):
        image.do(*step)
    return image


def test_it_starts_as_it_says(image):
    done = image.run([*image.entry, *image.command])
    assert done.returncode == 0
    assert "Usage: safestage" in done.stdout
    where = image.run(["python", "-c", "import safestage_eval; print(safestage_eval.__file__)"])
    assert where.stdout.startswith(str(image.home))


def test_the_kernels_are_compiled_for_whoever_runs_it(image, trace):
    """A user who can write nowhere finds machine code, and none is made."""
    kernels = image.root / "usr/local/share/safestage/kernels"
    before = {path: path.stat().st_mtime_ns for path in kernels.rglob("*") if path.is_file()}
    assert len(before) > 40
    for folder in (kernels, *(path for path in kernels.rglob("*") if path.is_dir())):
        folder.chmod(0o555)
    shutil.copy(trace, image.folder / "trace.mcap")
    done = image.run([*image.entry, "score", "trace.mcap"], HOME="/nowhere")
    assert done.returncode == 0, done.stderr
    assert "compil" not in done.stderr
    after = {path: path.stat().st_mtime_ns for path in kernels.rglob("*") if path.is_file()}
    assert after == before


def test_the_context_has_no_recordings_and_no_history(image):
    names = {path.name for path in (image.root / "src").iterdir()}
    assert {"pyproject.toml", "safestage_eval", "rules", "README.md"} <= names
    assert not names & {"traces", ".git", "tests", "recorder"}
