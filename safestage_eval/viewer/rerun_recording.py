"""An episode as a Rerun recording: the scene, what decided its rules with limits, events, and a blueprint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from safestage_eval._process.run_module import run_module
from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.evidence.intervals import Interval
from safestage_eval.formats.atomic import replacing, writing
from safestage_eval.formats.event import Event
from safestage_eval.formats.mcap.mcap_messages import EVENTS, log_time
from safestage_eval.formats.mcap.mcap_writer import write_mcap
from safestage_eval.palette import GROUNDS, INKS, SERIES, VERDICTS
from safestage_eval.report.signal_plot import Panel
from safestage_eval.units import in_unit, unit_of

from .episode_viewpoint import look_at

APPLICATION = "safestage"
"""Rerun applies a blueprint to recordings of the same application."""

TIMELINE = "message_log_time"
"""Name of a message's time in Rerun's reader of MCAP files."""


def require_rerun() -> None:
    """Raises InputError where Rerun's SDK is not installed."""
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise InputError(
            "--to rrd", "rerun-sdk is not installed.", fix='pip install "safestage[rerun]"'
        ) from None


def write_rerun(
    episode: Episode, events: Sequence[Event], decided: Sequence[Panel], path: Path
) -> Path:
    """Write ``path`` (.rrd), and the blueprint that it holds beside it (.rbl); returns the blueprint.

    Args:
        episode: any.
        events: remarks on its timeline.
        decided: signals that decided its rules, with their limits.
        path: each file appears whole or not at all.

    Raises:
        InputError: Rerun's SDK is missing or cannot convert the episode.
    """
    require_rerun()
    blueprint = path.with_suffix(".rbl")
    with TemporaryDirectory() as folder:
        scene, signals = Path(folder) / "scene.rrd", Path(folder) / "signals.rrd"
        plan = Path(folder) / "plan.rbl"
        write_mcap(episode, Path(folder) / "episode.mcap", events, placed=True)
        name = episode.header.episode_id
        run_module(
            "rerun", "mcap", "convert", str(Path(folder) / "episode.mcap"), "-o", str(scene),
            "--application-id", APPLICATION, "--recording-id", name,
        )  # fmt: skip
        _write_signals(episode, decided, signals)
        _blueprint(episode, decided).save(APPLICATION, str(plan))
        with writing(path) as part:
            run_module(
                "rerun", "rrd", "merge", str(plan), str(signals), str(scene), "-o", str(part)
            )
        with replacing(blueprint) as part:
            part.write_bytes(plan.read_bytes())
    return blueprint


def _write_signals(episode: Episode, decided: Sequence[Panel], path: Path) -> None:
    import rerun as rr

    stream = rr.RecordingStream(APPLICATION, recording_id=episode.header.episode_id)
    stream.save(str(path))
    times = np.array([log_time(t) for t in episode.t.tolist()], "datetime64[ns]")
    for n, panel in enumerate(decided):
        entity, unit = _entity(n), unit_of(panel.series.dimension)
        label = f"{panel.name} ({unit})" if unit else panel.name
        _line(stream, f"{entity}/value", label, SERIES[0].light, times, _shown(panel.series))
        ends = times[[0, -1]]
        for at, (bound, code) in enumerate(panel.limits):
            limit = in_unit(bound.value, panel.series.dimension)
            said = f"{code}: {bound.param or 'limit'}"
            colour = VERDICTS["violation"].light
            _line(stream, f"{entity}/limit_{at}", said, colour, ends, np.full(2, limit))
    stream.disconnect()


def _line(stream: Any, entity: str, name: str, colour: str, times: Any, values: Any) -> None:
    import rerun as rr

    measured = np.isfinite(values)
    stream.log(entity, rr.SeriesLines(names=name, colors=_rgba(colour)), static=True)
    stream.send_columns(
        entity,
        indexes=[rr.TimeColumn(TIMELINE, timestamp=times[measured])],
        columns=rr.Scalars.columns(scalars=values[measured]),
    )


def _shown(series: Interval) -> np.ndarray:
    """(T,) in the unit that people read; of a distance known only from below, that."""
    value = np.where(np.isfinite(series.value), series.value, series.lower)
    shown: np.ndarray = value * in_unit(1.0, series.dimension)
    return shown


def _entity(n: int) -> str:
    return f"/signals/signal_{n}"


def _rgba(colour: str) -> int:
    return int(colour.removeprefix("#") + "ff", 16)


def _blueprint(episode: Episode, decided: Sequence[Panel]) -> Any:
    import rerun.blueprint as rrb

    look = look_at(episode)
    flat = math.cos(look.elevation)
    along = (math.cos(look.azimuth) * flat, math.sin(look.azimuth) * flat, math.sin(look.elevation))
    eye = [at - look.distance * way for at, way in zip(look.at, along, strict=True)]
    scene = rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", "- /signals/**"],
        name="Scene",
        background=_rgba(GROUNDS["ground"].light),
        spatial_information=rrb.SpatialInformation(target_frame="world"),
        line_grid=rrb.LineGrid3D(visible=True, color=_rgba(INKS["line"].light)),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=list(look.at), eye_up=[0, 0, 1]),
    )
    log = rrb.TextLogView(origin=EVENTS, name="Events")
    curves = [
        rrb.TimeSeriesView(
            origin=_entity(n), name=panel.name,
            axis_y=rrb.ScalarAxis(zoom_lock=False), plot_legend=rrb.Corner2D.LeftTop,
        )
        for n, panel in enumerate(decided)
    ]  # fmt: skip
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Vertical(*curves, log), column_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
        auto_layout=False,
    )
