"""Sketch files: found by name, turned by knobs, refused with the place of every mistake."""

from pathlib import Path

import pytest

from safestage_eval.errors import InputError
from safestage_eval.formats import load
from safestage_eval.formats.save import save
from safestage_eval.sketch import SketchError, draw, read, resolve

HEAD = 'says = "x"\nduration = "1 s"\nrate = 20\n'
BOX = '[bodies.box]\nshape = "box 4 x 4 x 4 cm"\n'


def problems(text: str, **knobs: str) -> list[tuple[int, str, str]]:
    with pytest.raises(SketchError) as caught:
        draw(text, "bad.toml", "bad", knobs)
    return [(d.line, d.code, d.what) for d in caught.value.diagnostics]


def test_all_mistakes_at_once_each_at_its_place() -> None:
    found = problems(
        'says = "x"\n'
        'duration = "5"\n'
        "roels = {}\n"
        'story = [{ hold = "box", during = "2 to 1 s" },\n'
        '  { fly = "box" },\n'
        '  { move = "box", during = "0 to 1 s" }]\n'
        '[bodies.box]\nshape = "cylinder 10 cm"\nmass = "3 N"\n'
    )
    assert [(line, code) for line, code, _ in found] == [
        (2, "K201"), (3, "K201"), (4, "K201"), (5, "K202"), (6, "K201"), (8, "K201"), (9, "K201"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("story", "what"),
    [
        ('{ hold = "cup", during = "0 to 1 s" }', "no body"),
        ('{ drop = "box", at = "0 s" }', "nothing beneath"),
        ('{ touch = "box", by = "elbow", during = "0 to 1 s", force = "1 N" }', "no body"),
        (
            '{ hold = "box", during = "0 to 0.6 s" }, { reach = "0, 0, 9 cm", during = "0.5 to 1 s" }',
            "another place",
        ),
        ('{ channel = "heat", of = "stove", values = "1 at 0 s" }', "no body"),
    ],
)
def test_what_the_scene_lacks(story: str, what: str) -> None:
    ((line, code, said),) = problems(f"{HEAD}table = false\nstory = [{story}]\n{BOX}")
    assert (line, code) == (5, "K301")
    assert what in said


@pytest.mark.parametrize("value", ["3 inches", "1..2 cm", "cm", "3 + cm", "__import__('os') cm"])
def test_a_length_is_a_sum_of_numbers_with_a_unit(value: str) -> None:
    ((line, code, _),) = problems(f'{HEAD}table = false\n[bodies.box]\nshape = "box 1 x 1 x 1 cm"\n'
                                  f'at = "0, 0, {value}"\n')  # fmt: skip
    assert (line, code) == (7, "K201")


def test_knobs_turn_numbers_and_rename_the_episode(tmp_path: Path) -> None:
    (tmp_path / "box.toml").write_text(
        HEAD + 'knobs = { far = "3" }\n' + BOX + 'at = "10 + {far}, 0 cm"\n', encoding="utf-8"
    )
    assert resolve("box", [tmp_path]).tracks["box"].position[0, 0] == pytest.approx(0.13)
    turned = resolve("box(far = -2.5)", [tmp_path])
    assert turned.tracks["box"].position[0, 0] == pytest.approx(0.075)
    assert turned.header.episode_id == "box(far = -2.5)"
    with pytest.raises(SketchError, match="no knob 'fra'"):
        resolve("box(fra = 1)", [tmp_path])


@pytest.mark.parametrize("name", ["", "nothing_like_it", "box(", "box(far)"])
def test_a_name_without_example(name: str, tmp_path: Path) -> None:
    (tmp_path / "box.toml").write_text(HEAD + BOX, encoding="utf-8")
    with pytest.raises(InputError):
        resolve(name, [tmp_path])


@pytest.mark.parametrize("name", ["scene.mcap", "scenes"])
def test_a_drawn_episode_can_be_stored(name: str, tmp_path: Path) -> None:
    (tmp_path / "box.toml").write_text(HEAD + BOX, encoding="utf-8")
    episode = read(tmp_path / "box.toml")
    save(episode, tmp_path / name)
    assert load(tmp_path / name).content_hash == episode.content_hash
