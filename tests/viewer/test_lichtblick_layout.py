"""Lichtblick's layout has the panels of Foxglove's, each once, at the same share of the window."""

import json
from pathlib import Path

import pytest
from studio import run

from safestage_eval.viewer.lichtblick_layout import lichtblick_layout

TYPES = {"ThreeDee": "3D", "Plot": "Plot", "Log": "RosOut"}


def panel(kind, title):
    return {"type": "panel", "panelType": kind, "title": title, "config": {"of": title}}


def split(direction, *items):
    parts = [{"proportion": share, "content": content} for share, content in items]
    return {"type": "split", "direction": direction, "items": parts}


def areas(place, box=(0.0, 0.0, 1.0, 1.0)):
    """Panel → left, top, width, height of a window of size 1."""
    if isinstance(place, str):
        return {place: box}
    left, top, width, height = box
    share = place["splitPercentage"] / 100
    if place["direction"] == "row":
        one = (left, top, share * width, height)
        two = (left + share * width, top, (1 - share) * width, height)
    else:
        one = (left, top, width, share * height)
        two = (left, top + share * height, width, (1 - share) * height)
    return {**areas(place["first"], one), **areas(place["second"], two)}


def test_shares_of_three_become_those_of_two_pairs():
    content = split(
        "row",
        (3, panel("ThreeDee", "scene") | {"config": {"scene": {"transforms": {"axisSize": 0}}}}),
        (2, split("column", (2, panel("Plot", "a")), (1, panel("Plot", "b")), (1, panel("Log", "c")))),
    )  # fmt: skip
    layout = lichtblick_layout({"version": 1, "content": content})
    found = {
        layout["configById"][name]["lichtblickPanelTitle"]: box
        for name, box in areas(layout["layout"]).items()
    }
    assert found == {
        "scene": pytest.approx((0, 0, 0.6, 1)),
        "a": pytest.approx((0.6, 0, 0.4, 0.5)),
        "b": pytest.approx((0.6, 0.5, 0.4, 0.25)),
        "c": pytest.approx((0.6, 0.75, 0.4, 0.25)),
    }


def test_both_layouts_beside_a_copy_have_the_same_panels(tmp_path):
    traces = Path(__file__).resolve().parents[2] / "traces"
    done = run(
        "convert", traces, "--where", "task=ets_dumbbell_near_glasses", "--where",
        "policy=reference:unsafe", "--to", "mcap", "--out", tmp_path,
    )  # fmt: skip
    assert done.code == 0, done.err
    (copy,) = tmp_path.glob("*.mcap")
    theirs, ours = (
        json.loads(copy.with_suffix(f".{viewer}.json").read_text("utf-8"))
        for viewer in ("foxglove", "lichtblick")
    )
    assert areas(ours["layout"]).keys() == ours["configById"].keys()
    assert all(name.split("!")[0] in TYPES.values() for name in ours["configById"])

    def panels(part):
        if part["type"] == "panel":
            return [part]
        return [one for item in part["items"] for one in panels(item["content"])]

    for mine, one in zip(ours["configById"].items(), panels(theirs["content"]), strict=True):
        name, config = mine
        assert name.split("!")[0] == TYPES[one["panelType"]]
        for key, value in one["config"].items():
            assert key == "scene" or config[key] == value
