"""Converts a Foxglove layout for Lichtblick, the open-source fork of Foxglove Studio."""

from __future__ import annotations

from typing import Any

TYPES = {"ThreeDee": "3D", "Plot": "Plot", "Log": "RosOut"}
"""Type of a panel in Foxglove layouts → in Lichtblick layouts."""


def lichtblick_layout(layout: dict[str, Any]) -> dict[str, Any]:
    """A layout of Foxglove, version 1, as "Import from file" of Lichtblick takes it.

    Splits become pairs, shares become per cent of the first of the two.
    """
    configs: dict[str, dict[str, Any]] = {}
    places = _placed(layout["content"], configs)
    return {
        "configById": configs,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": places,
    }


def _placed(part: dict[str, Any], configs: dict[str, dict[str, Any]]) -> Any:
    """A panel's id, or a pair of parts; panels are added to ``configs``."""
    if part["type"] == "panel":
        name = f"{TYPES[part['panelType']]}!{len(configs)}"
        configs[name] = {**_spelt(part["config"]), "lichtblickPanelTitle": part["title"]}
        return name
    return _paired(part["direction"], part["items"], configs)


def _paired(direction: str, items: list[dict[str, Any]], configs: dict[str, dict[str, Any]]) -> Any:
    first, *rest = items
    if not rest:
        return _placed(first["content"], configs)
    whole = sum(item["proportion"] for item in items)
    return {
        "direction": direction,
        "first": _placed(first["content"], configs),
        "second": _paired(direction, rest, configs),
        "splitPercentage": round(100 * first["proportion"] / whole, 1),
    }


def _spelt(config: dict[str, Any]) -> dict[str, Any]:
    """Settings as Lichtblick names them: axes of frames have a scale in place of a size in pixels."""
    scene = config.get("scene")
    if scene is None:
        return config
    frames = dict(scene["transforms"])
    frames["axisScale"] = frames.pop("axisSize")
    return {**config, "scene": {**scene, "transforms": frames}}
