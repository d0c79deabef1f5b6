"""The fixture that holds a lab's goldens, in a pytest run of its own."""

import json
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest
from studio import safe_and_unsafe

from safestage_eval.report.golden import write_golden
from safestage_eval.run.score_traces import score_paths

CHECKOUT = Path(__file__).parents[2]

TESTS = """
def test_as_expected(safestage_golden):
    safestage_golden("traces", "expected.json", rules="fsh")

def test_another_limit(safestage_golden):
    safestage_golden(["traces"], "changed.json", rules=["fsh"], edge="4 mm")

def test_gone(safestage_golden):
    safestage_golden("traces/safe.mcap", "expected.json", rules="fsh")

def test_broken(safestage_golden):
    safestage_golden(["traces", "broken"], "kept.json", rules="fsh")

def test_no_golden(safestage_golden):
    safestage_golden("traces", "new.json", rules="fsh")
"""


@pytest.fixture
def lab(tmp_path):
    """A folder with traces, golden files, and a test for each thing that may have happened."""
    for folder in ("traces", "broken"):
        (tmp_path / folder).mkdir()
    safe_and_unsafe(tmp_path / "traces")
    (tmp_path / "broken" / "cut.mcap").write_bytes(b"\x89MCAP0\r\n and then nothing")
    scores = score_paths([tmp_path / "traces"], ["fsh"], jobs=1)
    for name in ("expected", "changed", "kept"):
        write_golden(scores, tmp_path / f"{name}.json")
    (tmp_path / "test_it.py").write_text(TESTS, "utf-8")
    return tmp_path


def run(lab, *arguments):
    """Lines that pytest prints there, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "safestage_eval.pytest_plugin", "-p",
         "no:cacheprovider", "--rootdir", lab, *arguments, lab],
        cwd=CHECKOUT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout + done.stderr


def limit(lab, name):
    golden = json.loads((lab / name).read_text("utf-8"))
    return golden["episodes"]["unsafe"]["rules"]["FSH101"]["limit"]


def test_each_test_says_what_changed_and_why(lab):
    said = run(lab)
    assert "4 failed, 1 passed" in said
    for words in (
        r"changed.json: \d differences?; if they are meant, pytest --safestage-update",
        r"  unsafe: FSH101: verdict violation → pass.* limit 2\.0 cm → 0\.4 cm.*digest \w+ → \w+",
        r"unsafe: expected, but not among the episodes",
        r"cannot be judged: .*cut\.mcap",
        r"new\.json: cannot be read.*pytest --safestage-update",
    ):
        assert re.search(words, said), words


@pytest.mark.slow
def test_updating_writes_what_can_be_judged(lab):
    before = (lab / "kept.json").read_bytes()
    assert "1 failed, 4 passed" in run(lab, "--safestage-update")
    assert (lab / "kept.json").read_bytes() == before
    assert limit(lab, "changed.json") == pytest.approx(0.004)
    assert limit(lab, "new.json") == pytest.approx(0.02)


def test_it_is_there_once_installed():
    """Under its own name, so that ``-p`` and the entry point are one and the same."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))
    for name, module in project["project"]["entry-points"]["pytest11"].items():
        assert name == module
        assert import_module(module).pytest_addoption
