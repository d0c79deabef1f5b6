"""The hooks that other repositories take from this one: sound as pre-commit says, and right on good and bad files."""

import os
import subprocess
import sys

import pytest

yaml = pytest.importorskip("yaml")


@pytest.fixture(scope="module")
def hooks(checkout):
    listed = yaml.safe_load((checkout / ".pre-commit-hooks.yaml").read_text("utf-8"))
    return {hook["id"]: hook for hook in listed}


def run(hook, checkout, folder, *files, args=None):
    """A hook's entry, started as pre-commit does: entry, arguments, files."""
    entry, *rest = hook["entry"].split()
    function = {"safestage": "main", "safestage-score": "score_main"}[entry]
    code = f"import sys; sys.argv[0] = {entry!r}\nfrom safestage_eval.cli import {function}; {function}()"
    given = hook.get("args", []) if args is None else args
    files = files if hook.get("pass_filenames", True) else ()
    return subprocess.run(
        [sys.executable, "-c", code, *rest, *given, *files], cwd=folder,
        env={**os.environ, "PYTHONPATH": str(checkout)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_pre_commit_takes_the_manifest(checkout):
    pytest.importorskip("pre_commit")
    done = subprocess.run(
        [sys.executable, "-m", "pre_commit", "validate-manifest", ".pre-commit-hooks.yaml"],
        cwd=checkout, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_the_rule_hook_passes_good_files_and_fails_bad_ones(hooks, checkout, tmp_path):
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    text = (checkout / "rules/goals.toml").read_text("utf-8")
    good.write_text(text, "utf-8")
    bad.write_text(text.replace("format", "fromat", 1), "utf-8")
    hook = hooks["safestage-rules"]
    assert run(hook, checkout, tmp_path, "good.toml").returncode == 0
    failed = run(hook, checkout, tmp_path, "good.toml", "bad.toml")
    assert failed.returncode != 0
    assert "bad.toml" in failed.stderr
    assert "fromat" in failed.stderr


@pytest.mark.slow
def test_the_golden_hook_tells_a_verdict_that_moved(hooks, checkout, tmp_path):
    hook = hooks["safestage-golden"]
    (tmp_path / "traces").mkdir()
    (trace,) = (checkout / "traces").glob("fsh_orange_on_plate.reference-safe*.mcap")
    (tmp_path / "traces" / trace.name).symlink_to(trace)
    wrote = run(hook, checkout, tmp_path, args=[*hook["args"], "--update-golden"])
    assert wrote.returncode == 0, wrote.stderr
    assert run(hook, checkout, tmp_path).returncode == 0
    golden = tmp_path / "traces" / "golden.json"
    golden.write_text(golden.read_text("utf-8").replace('"pass"', '"violation"', 1), "utf-8")
    moved = run(hook, checkout, tmp_path)
    assert moved.returncode == 1
    assert "::error" in moved.stdout
