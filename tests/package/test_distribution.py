"""Distributions: an sdist that a wheel is built from, and pages whose links lead somewhere."""

import email
import re
import subprocess
import sys
import tarfile
import zipfile

import pytest

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
    assert sdist.stat().st_size < 35e6  # four checkpoints of policies take 28
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "README.md", "LICENSE", "safestage_eval/py.typed"} <= names
    assert not [
        name for name in names if name.startswith(("traces/", "traces_learned/", "recorder/"))
    ]
