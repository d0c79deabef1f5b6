"""docs/sketches.md: its scene can be drawn and means what it says, and no step or shape is left out."""

import re
from pathlib import Path

import pytest

from safestage_eval import sketch
from safestage_eval.rules import load_rules
from safestage_eval.sketch.quantities import SHAPES
from safestage_eval.sketch.sketch_model import STEPS, BodySketch
from safestage_eval.verdicts import judge

PAGE = (Path(__file__).parents[2] / "docs" / "sketches.md").read_text("utf-8")


@pytest.mark.parametrize(("gap", "verdict"), [("7.9", "violation"), ("8.1", "pass")])
def test_the_scene_is_as_stated(gap: str, verdict: str) -> None:
    (scene,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    episode = sketch.draw(scene, "page", "past_can", {"gap": gap})
    found = {v.rule: v.verdict for v in judge(episode, load_rules(["ets", "fsh"])).verdicts}
    assert found["ETS201"] == verdict
    assert found["FSH105"] == "pass"


def test_the_mistake_is_shown_as_printed() -> None:
    with pytest.raises(sketch.SketchError) as caught:
        sketch.draw('says     = "x"\nduration = "5"\n', "past_can.toml", "past_can")
    assert caught.value.diagnostics[0].render() in PAGE


def test_nothing_is_left_out() -> None:
    for name in (*STEPS, *SHAPES, *BodySketch.model_fields):
        assert re.search(rf"\b{name}\b", PAGE), name


@pytest.mark.parametrize("verb", STEPS)
def test_each_step_can_be_written_as_shown(verb: str) -> None:
    (row,) = re.findall(rf"^\| `{verb}` \|.*$", PAGE, re.MULTILINE)
    (written,) = re.findall(r"`(\{ .* \})` \|$", row)
    bodies = "".join(
        f'[bodies.{name}]\nshape = "cylinder 6 x 10 cm"\nat = "{x}, 0 cm"\nmass = "200 g"\n'
        for name, x in (("cup", 0), ("can", 40))
    )
    text = f'says = "x"\nduration = "5 s"\nstory = [{written}]\n{bodies}'
    if verb == "roll":
        text = text.replace('shape = "cylinder 6 x 10 cm"', 'shape = "cylinder 6 x 10 cm along y"')
    assert len(sketch.draw(text, "page", "page")) == 301
