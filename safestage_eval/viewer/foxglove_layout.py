"""How Foxglove shows an episode's MCAP file: its layout, version 1, as its own SDK writes it."""

from __future__ import annotations

import math
from typing import Any

from safestage_eval.episode import Episode
from safestage_eval.formats.mcap.mcap_messages import CONTACTS, EVENTS, FRAME, SCENE
from safestage_eval.formats.mcap.mcap_writer import moving_bodies
from safestage_eval.palette import GROUNDS, INKS, SERIES

from .episode_viewpoint import look_at

NO_FRAMES = {"axisSize": 0, "lineWidth": 0, "showLabel": False}
"""Axes, links and names of sixty frames would hide the scene."""


def foxglove_layout(episode: Episode) -> dict[str, Any]:
    """The scene from where something is to be seen, events, and heights of the bodies that matter.

    "Import from file" in Foxglove's list of layouts takes it.
    """
    side = _split("column", [(2, _plot(episode)), (1, _plot_of_gripper()), (2, _events())])
    return {"version": 1, "content": _split("row", [(3, _scene(episode)), (2, side)])}


def _split(direction: str, items: list[tuple[float, dict[str, Any]]]) -> dict[str, Any]:
    parts = [{"proportion": share, "content": content} for share, content in items]
    return {"type": "split", "direction": direction, "items": parts}


def _panel(kind: str, title: str, config: dict[str, Any]) -> dict[str, Any]:
    return {"type": "panel", "panelType": kind, "config": config, "title": title, "version": 1}


def _scene(episode: Episode) -> dict[str, Any]:
    look = look_at(episode)
    camera = {
        "distance": look.distance,
        "perspective": True,
        "phi": round(90 + math.degrees(look.elevation), 2),  # deg from z to the eye
        "thetaOffset": round((90 - math.degrees(look.azimuth)) % 360, 2),  # deg, 0 looks along y
        "target": [0, 0, 0],
        "targetOffset": list(look.at),
        "targetOrientation": [0, 0, 0, 1],
        "fovy": 45,
        "near": 0.01,
        "far": 100,
    }
    grid = {"layerId": "foxglove.Grid", "visible": True, "frameId": "world", "size": 4,
            "divisions": 8, "color": INKS["line"].light}  # fmt: skip
    return _panel(
        "ThreeDee",
        "Scene",
        {
            "scene": {"backgroundColor": GROUNDS["ground"].light, "transforms": NO_FRAMES},
            "layers": {"grid": grid},
            "topics": {SCENE: {"visible": True}, CONTACTS: {"visible": True, "pointSize": 8}},
            "cameraState": camera,
            "followTf": "world",
            "followMode": "follow-none",
        },
    )


def _plot(episode: Episode) -> dict[str, Any]:
    """Heights of the bodies with a role, or of all objects that move."""
    places = {name: n for n, name in enumerate(moving_bodies(episode))}
    playing = [name for names in episode.header.roles.values() for name in names]
    objects = [body.name for body in episode.header.bodies if body.kind == "object"]
    shown = dict.fromkeys(name for name in (*playing, *objects) if name in places)
    paths = [
        {
            "value": f"{FRAME}.body_position[{3 * places[name] + 2}]",
            "label": name,
            "color": colour.light,
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for name, colour in zip(shown, SERIES, strict=False)
    ]
    return _panel(
        "Plot",
        "Heights (m)",
        {"paths": paths, "yAxisLabel": "z (m, world)", "isSynced": True, "showLegend": True},
    )


def _plot_of_gripper() -> dict[str, Any]:
    line = {"value": f"{FRAME}.gripper[0]", "label": "gripper", "enabled": True,
            "color": SERIES[0].light, "timestampMethod": "receiveTime"}  # fmt: skip
    return _panel(
        "Plot",
        "Gripper, 0 closed to 1 open",
        {"paths": [line], "minYValue": 0, "maxYValue": 1, "isSynced": True, "showLegend": False},
    )


def _events() -> dict[str, Any]:
    config = {"topicToRender": EVENTS, "minLogLevel": 1, "showName": True, "showTime": True}
    return _panel("Log", "Events", config)
