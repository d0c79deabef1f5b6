"""The layout beside an MCAP file is one that Foxglove's own SDK would write, and names what is there."""

import json
import math
import re
from pathlib import Path

import foxglove.layouts as fl
import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from safestage_eval.cli import group
from safestage_eval.formats import load
from safestage_eval.viewer.episode_viewpoint import look_at
from safestage_eval.viewer.foxglove_layout import foxglove_layout

CONTAINERS = {"split": fl.SplitContainer}
PANELS = {"ThreeDee": fl.ThreeDeePanel, "Plot": fl.PlotPanel, "Log": fl.LogPanel}


@pytest.fixture(scope="module")
def trace():
    """A recorded episode with a violation, in one file."""
    traces = Path(__file__).resolve().parents[2] / "traces"
    (path,) = traces.glob("ets_dumbbell_near_glasses.reference-unsafe*.mcap")
    return path


@pytest.fixture(scope="module")
def exported(trace, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    done = CliRunner().invoke(
        group, ["convert", str(trace), "--to", "mcap", "--out", str(out), "--no-events"]
    )
    assert done.exit_code == 0, done.output
    (copy,) = out.glob("*.mcap")
    return copy, json.loads(copy.with_suffix(".foxglove.json").read_text("utf-8"))


def panels(content):
    if content["type"] == "panel":
        return [content]
    return [panel for item in content["items"] for panel in panels(item["content"])]


def keys_of(kind):
    """The keys that Foxglove's SDK gives an object of a kind."""
    return {*kind()._to_dict()}


def spelt(content):
    """Bytes that the SDK writes for the same content, built from its own classes."""
    if content["type"] == "split":
        items = [
            fl.SplitItem(proportion=item["proportion"], content=spelt(item["content"]))
            for item in content["items"]
        ]
        return fl.SplitContainer(direction=content["direction"], items=items)
    return PANELS[content["panelType"]](title=content["title"], config=content["config"])


def test_the_layout_has_the_form_of_foxgloves_sdk(exported):
    _, layout = exported
    assert json.loads(fl.Layout(content=spelt(layout["content"])).to_json()) == layout


def test_settings_of_panels_are_those_that_the_sdk_knows(exported):
    _, layout = exported
    configs = {"ThreeDee": fl.ThreeDeeConfig, "Plot": fl.PlotConfig, "Log": fl.LogConfig}
    for panel in panels(layout["content"]):
        assert panel["config"].keys() <= keys_of(configs[panel["panelType"]])
        for line in panel["config"].get("paths", ()):
            assert line.keys() <= keys_of(fl.PlotSeries)
    (scene,) = [p["config"] for p in panels(layout["content"]) if p["panelType"] == "ThreeDee"]
    assert scene["cameraState"].keys() <= keys_of(fl.ThreeDeeCameraState)
    assert scene["scene"].keys() <= keys_of(fl.BaseRendererSceneSettings)
    assert scene["layers"]["grid"].keys() <= {
        *keys_of(fl.BaseRendererGridLayerSettings),
    }
    assert scene["topics"]["/safestage/contacts"].keys() <= keys_of(
        fl.BaseRendererPointCloudTopicSettings
    )


def test_it_names_topics_and_fields_that_the_file_has(exported):
    copy, layout = exported
    with copy.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        topics = {channel.topic for channel in reader.get_summary().channels.values()}
        frame = next(reader.iter_decoded_messages(topics=["/safestage/frame"])).decoded_message
    text = json.dumps(layout)
    named = set(re.findall(r'"(/[a-z_/]+)', text))
    assert named
    assert named <= topics
    fields = re.findall(r'"/safestage/frame\.(\w+)\[(\d+)\]"', text)
    assert len(fields) > 1
    assert all(int(index) < len(getattr(frame, name)) for name, index in fields)


def test_each_height_is_that_of_the_body_it_is_labelled_with(exported):
    copy, layout = exported
    episode = load(copy)
    with copy.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        frame = next(reader.iter_decoded_messages(topics=["/safestage/frame"])).decoded_message
    lines = [
        line
        for panel in panels(layout["content"])
        for line in panel["config"].get("paths", ())
        if "body_position" in line["value"]
    ]
    playing = {name for names in episode.header.roles.values() for name in names}
    assert {line["label"] for line in lines} & playing
    for line in lines:
        index = int(line["value"].rpartition("[")[2].rstrip("]"))
        assert frame.body_position[index] == episode.tracks[line["label"]].position[0, 2]


def test_the_camera_stands_where_our_own_viewer_stands(trace):
    """Foxglove's eye: ``distance`` from the target, ``phi`` from z, seen along y at ``thetaOffset`` 0."""
    episode = load(trace)
    (scene,) = [
        p["config"]
        for p in panels(foxglove_layout(episode)["content"])
        if p["panelType"] == "ThreeDee"
    ]
    camera, look = scene["cameraState"], look_at(episode)
    phi, theta = math.radians(camera["phi"]), math.radians(camera["thetaOffset"])
    theirs = camera["distance"] * np.array(
        [-math.sin(phi) * math.sin(theta), -math.sin(phi) * math.cos(theta), math.cos(phi)]
    )
    along = [
        math.cos(look.elevation) * math.cos(look.azimuth),
        math.cos(look.elevation) * math.sin(look.azimuth),
        math.sin(look.elevation),
    ]
    assert np.allclose(theirs, -look.distance * np.array(along), atol=1e-3)
    assert camera["targetOffset"] == list(look.at)
