"""Tasks, prompts, campaigns and policies of strangers, in what the simulator's commands print and write."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hostile_text import EVIL, is_inert
from studio import run

from simulate.tasks.task import FOLDER

pytestmark = pytest.mark.simulate

PLAIN = "fsh_tumbler_on_mat"


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A task of which every free text is hostile."""
    text = (FOLDER / f"{PLAIN}.toml").read_text("utf-8")
    free = r"^(family|default|generic|specific|parameter)( *= ).*$"
    text = re.sub(free, lambda m: m[1] + m[2] + json.dumps(EVIL), text, flags=re.M)
    path = tmp_path_factory.mktemp("task") / "theirs.toml"
    path.write_text(text, "utf-8")
    return path


@pytest.fixture(scope="module")
def recorded(task: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two prompts of it, recorded for a moment."""
    out = tmp_path_factory.mktemp("out") / "x\x1b[31m\u202e"
    done = run(
        "record", task, "--policy", "idle", "--duration", "0.1", "--seeds", "0", "--out", out,
        "--prompt", "default", "--prompt", "specific", "--monitor", "fsh", "--jobs", "1",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert is_inert(done.text + done.err), done.text + done.err
    assert len(list((out / "meta/episodes").iterdir())) == 2
    return out


COMMANDS = [
    "tasks show {task}",
    "tasks show {task} --json",
    "tasks show no\x1b[31m\u202esuch",
    "tasks list --family \x1b[31m*",
    "tasks validate no\x1b[31m\u202esuch",
    "record {task} --dry-run",
    "record no\x1b[31m\u202esuch.toml",
    "record {task} --policy \x1b[31mnone --out {out}",
    "record {task} --policy replay:\x1b[31m\u202enone --out {out}",
    "record {task} --policy openpi:ws://\x1b[31m --out {out}",
    "record {task} --seeds \x1b[31m --out {out}",
    "record {task} --policy idle --monitor \x1b[31m --out {out}",
    "record {odd} --out {out}",
    "record --campaign {campaign} --out {out}",
    "record --campaign {odd} --out {out}",
    "serve \x1b[31mnone --protocol openpi",
    "serve idle --protocol \x1b[31mnone",
    "render {recorded} -e \x1b[31mnone -o {out}.gif",
    "inspect {recorded}",
    "score {recorded} --rules fsh",
    "score {recorded} --rules fsh -f markdown",
    "explain {recorded}",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_of_a_task_moves_the_cursor_or_begins_a_line(
    task: Path, recorded: Path, tmp_path: Path, command: str
) -> None:
    odd, campaign = tmp_path / "odd.toml", tmp_path / "campaign.toml"
    odd.write_text(f"{json.dumps(EVIL)} = {json.dumps(EVIL)}\nid = {json.dumps(EVIL)}\n", "utf-8")
    campaign.write_text(
        f"tasks = [{json.dumps(EVIL)}]\npolicies = [{json.dumps(EVIL)}]\nseeds = [0]\n", "utf-8"
    )
    names = {"task": task, "recorded": recorded, "odd": odd, "campaign": campaign}
    done = run(*(word.format(**names, out=tmp_path / "out") for word in command.split(" ")))
    assert is_inert(done.text), done.text
    assert is_inert(done.err), done.err
    assert "Traceback" not in done.err
