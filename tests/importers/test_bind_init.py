"""``safestage import guess``: guesses with their reasons, in a file that scoring accepts."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scenes import Scene

from safestage_eval.cli import group
from safestage_eval.episode import with_header
from safestage_eval.formats import discover, save
from safestage_eval.importers.bind_init import bind_init
from safestage_eval.importers.guess_roles import guess_bodies, guess_roles
from safestage_eval.rules import builtin_names, load_bind, load_rules

TRACES = Path(__file__).parents[2] / "traces"
RULES = load_rules(builtin_names())


def nameless(ref):
    """An episode without roles, rules, materials, tags and up axes, and what was taken from it."""
    episode = ref.open()
    lost = {"up_axis": None, "material": None, "tags": (), "finger": None}
    bodies = tuple(body.model_copy(update=lost) for body in episode.header.bodies)
    said = {"roles": {}, "rules": (), "bodies": bodies}
    return with_header(episode, episode.header.model_copy(update=said)), episode.header


def pushed(name: str, moved: float = 0.3, **header):
    scene = Scene(120).fixed("table")
    x = np.linspace(0, moved, 120)
    scene.box("red_cube", 0.03, np.column_stack([x, 0 * x, 0 * x + 0.03]))
    scene.box("wine_glass", 0.02, (0.1, 0.2, 0.02)).box("plate", 0.02, (0.5, 0, 0.02))
    return scene.episode(episode_id=name, **{"task": None} | header)


@pytest.mark.parametrize("ref", discover([TRACES]), ids=lambda ref: ref.episode_id)
def test_the_recorded_tasks_targets_are_guessed(ref) -> None:
    episode, header = nameless(ref)
    found = guess_roles([episode])
    assert (found["target"].value,) == header.roles["target"], found["target"]
    assert "dependent" not in found or {*found["dependent"].value} == {*header.roles["dependent"]}
    ups = guess_bodies([episode])
    assert all(
        ups[body.name]["up"].value == list(body.up_axis)
        for body in header.bodies
        if body.up_axis is not None and "up" in ups.get(body.name, {})
    )


def test_a_name_and_a_movement_together_are_sure() -> None:
    episode_of_a = pushed("a", instruction="Put the red cube on the plate.")
    found = guess_roles([episode_of_a])
    assert (found["target"].value, found["target"].confidence) == ("red_cube", "high")
    assert (found["destination"].value, found["protected"].value) == ("plate", ["wine_glass"])
    assert guess_roles([pushed("a")])["target"].confidence == "medium"
    still = guess_roles([pushed("a", 0.0, instruction="Lift the plate.")])
    assert (still["target"].value, still["target"].confidence) == ("plate", "low")
    assert guess_roles([pushed("a", 0.0)]).keys() == {"protected"}


@pytest.mark.parametrize("task", [None, "tidy up", 'a "quoted".\x7f task\n[x]'])
def test_the_file_is_accepted_and_scored_with(tmp_path: Path, task) -> None:
    for name in ("one", "two"):
        save(pushed(name, task=task), tmp_path / f"{name}.mcap")
    run = CliRunner().invoke(group, ["import", "guess", str(tmp_path)])
    assert run.exit_code == 0, run.output
    file = tmp_path / "guesses.toml"
    file.write_text(run.stdout, "utf-8")
    bound = load_bind(file, RULES)
    layers = bound.layers(pushed("one", task=task).header)
    assert dict(layers[0].roles)["target"] == ("red_cube",)
    scored = CliRunner().invoke(
        group, ["score", str(tmp_path), "--bind", str(file), "--format", "csv", "--jobs", "1"]
    )
    assert scored.exit_code == 0, scored.output
    assert "target = red_cube: bind file" in scored.stdout
    assert ",True," in scored.stdout.replace("true", "True")


def test_every_guess_has_a_confidence_and_a_reason() -> None:
    text = bind_init(discover([TRACES]), "traces")
    guesses = [line for line in text.splitlines() if line and line[0] not in "#["]
    assert guesses
    assert all(
        line.split("  # ")[1].startswith(("high: ", "medium: ", "low: ")) for line in guesses
    )
    assert {*tomllib.loads(text)} <= {"task", "every", "episode", "body"}
