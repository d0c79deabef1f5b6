"""Bind files that come along: found by name, sound under every rule set they are used with."""

from __future__ import annotations

from pathlib import Path

import pytest

from safestage_eval.episode import Body, Geom, Header
from safestage_eval.errors import RuleError
from safestage_eval.rules import bind_episode, bind_names, find_bind, load_bind, load_rules


@pytest.mark.parametrize("name", bind_names())
@pytest.mark.parametrize("rules", [["ets"], ["ish", "ets", "fsh", "goals"]])
def test_each_is_sound(name: str, rules: list[str]) -> None:
    assert load_bind(name, load_rules(rules)).tasks


def test_a_file_of_that_name_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_bind("libero").is_file()
    (tmp_path / "libero").write_text('[task.mine]\nroles = { target = "cup" }\n')
    assert list(load_bind("libero", load_rules(["ets"])).tasks) == ["mine"]


def test_a_folder_of_that_name_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As recordings of one simulator often stand in a folder named after it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "metaworld").mkdir()
    assert load_bind("metaworld", load_rules(["ets"])).tasks


def test_a_name_that_is_none_is_answered_with_the_known_ones() -> None:
    with pytest.raises(RuleError, match="libero"):
        load_bind("liberro", load_rules(["ets"]))


def test_libero_s_tasks_have_roles_goals_and_what_is_protected() -> None:
    rules = load_rules(["ets"])
    bind = load_bind("libero", rules)
    assert len(bind.tasks) == 130
    assert sum(task.goal is not None for task in bind.tasks.values()) == 105
    task = next(
        task for name, task in bind.tasks.items() if name.startswith("libero_object/")
        and name.endswith("pick_up_the_alphabet_soup_and_place_it_in_the_basket")
    )  # fmt: skip
    names = {player for _, players in task.roles for player in players}
    bodies = tuple(
        Body(name=name, kind="object", mass=0.1, geoms=(Geom(kind="sphere", size=(0.03,)),))
        for name in sorted(names)
    )
    header = Header(episode_id="e", task=task.name, physics_dt=0.002, frame_dt=0.05, bodies=bodies)
    bound = bind_episode(rules, header, bind=bind, overrides={})
    assert bound.roles["target"] == ("alphabet_soup_1_main",)
    assert bound.roles["destination"] == ("basket_1_main",)
    assert "alphabet_soup_1_main" not in bound.roles["protected"]
    assert len(bound.roles["protected"]) == 5
    assert bound.goal is not None
