"""A film of a recorded episode, that stands still at the worst moment, with what was measured drawn in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.formats.atomic import writing
from safestage_eval.viewer.camera_film import VERDICT_MARK
from safestage_eval.viewer.episode.witness_segment import witness

from .dressing import recorded_look
from .marks import PASSED, VIOLATED, captioned, frame_at, in_rows, legend, moment, role_colors
from .renderer import VIEWS, Camera, EpisodeRenderer, Image, Style

if TYPE_CHECKING:
    from safestage_eval.verdicts import EpisodeResult

STILL = 1.5
"""s that the film stands still at the worst moment."""
RATES = {".mp4": 30, ".gif": 10, ".webp": 10}
"""Ending → pictures per second."""
GREY = (0.25, 0.25, 0.25)


def film(
    episode: Episode,
    result: EpisodeResult,
    path: Path,
    *,
    size: tuple[int, int] = (640, 440),
    camera: Camera = VIEWS["front"],
    speed: float = 1.0,
    plain: bool = False,
    progress: Callable[[int, int | None], None] | None = None,
) -> int:
    """Write an MP4, GIF or WebP; the number of its pictures.

    Args:
        episode: what happened.
        result: what was judged.
        path: its ending says which.
        size: width, height of the pictures; a bar with words comes below.
        camera: from where.
        speed: times real time.
        plain: draw the shapes that are judged, without room and skins.
        progress: told (done, total) pictures.

    Raises:
        InputError: another ending, or what is needed for it is not installed.
    """
    if path.suffix.lower() not in RATES:
        raise InputError(str(path), "no such film.", ", ".join(RATES))
    rate = RATES[path.suffix.lower()]
    pictures = _pictures(episode, result, rate / speed, rate, size, camera, plain, progress)
    form = path.suffix.lower()[1:]
    with writing(path) as part:
        return {"mp4": _mp4, "gif": _gif, "webp": _webp}[form](pictures, part, rate)


def _pictures(
    episode: Episode,
    result: EpisodeResult,
    per_second: float,
    rate: int,
    size: tuple[int, int],
    camera: Camera,
    plain: bool,
    progress: Callable[[int, int | None], None] | None = None,
) -> Iterator[Image]:
    verdict, header = moment(result), episode.header
    decisive = None if verdict.time is None else frame_at(episode, verdict.time)
    color, measured = VIOLATED if verdict.violated else PASSED, None
    if verdict.of is not None and (drawn_in := witness(verdict.of, header, result.success_time)):
        measured = (drawn_in["a"], drawn_in["b"]) if drawn_in["kind"] == "gap" else None
    times = np.arange(0.0, float(episode.t[-1]), 1 / per_second)
    frames = [frame_at(episode, time) for time in times]
    if decisive is not None:
        after = next((i for i, frame in enumerate(frames) if frame >= decisive), len(frames))
        frames[after:after] = [decisive] * round(STILL * rate)
    roles = legend(header)
    longest = f"{header.episode_id}  {episode.t[-1]:5.2f} s  goal reached"
    rows = len(in_rows(longest, size[0])) + max(
        len(in_rows(text, size[0])) for text in (roles, verdict.words)
    )
    look = None if plain else recorded_look(header)
    # without a GPU half of the time
    style = Style(role_colors(header), shadow=1024, samples=0, look=look)
    with EpisodeRenderer(episode, *size, style=style) as renderer:
        last, rendered, drawn = -1, -1, np.empty(0, np.uint8)
        image = drawn
        for number, frame in enumerate(frames, 1):
            if frame != last:
                here = frame == decisive and measured is not None
                if rendered < 0 or here or not renderer.still(frame, rendered):
                    between = measured if here else None
                    image = renderer.frame(frame, camera, between=between, line=color)
                    rendered = -1 if here else frame  # the line is in no other picture
                reached = decisive is not None and frame >= decisive
                done = header.success_time is not None and episode.t[frame] >= header.success_time
                state = "  goal reached" if done else ""
                first = f"{header.episode_id}  {episode.t[frame]:5.2f} s{state}"
                second = (verdict.words, color) if reached else (roles, GREY)
                now = color if frame == decisive else None
                drawn, last = captioned(image, [(first, GREY), second], now, rows), frame
            yield drawn
            if progress is not None:
                progress(number, len(frames))


def _mp4(pictures: Iterator[Image], path: Path, rate: int) -> int:
    try:
        import av
    except ImportError:
        raise InputError(str(path), "no PyAV.", fix="pip install 'safestage[video]'") from None
    count = 0
    with av.open(str(path), "w", format="mp4") as file:
        file.metadata["comment"] = VERDICT_MARK.decode()  # such films are not for labelling
        stream = file.add_stream("libx264", rate=Fraction(rate))
        stream.pix_fmt, stream.options = "yuv420p", {"crf": "26", "preset": "veryfast"}
        for picture in pictures:
            if not count:
                stream.height, stream.width = picture.shape[:2]
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
            count += 1
        file.mux(stream.encode())
    return count


def _gif(pictures: Iterator[Image], path: Path, rate: int) -> int:
    return _animated(pictures, path, rate, colors=64)


def _webp(pictures: Iterator[Image], path: Path, rate: int) -> int:
    return _animated(pictures, path, rate, method=4, quality=60, minimize_size=True)


def _animated(
    pictures: Iterator[Image], path: Path, rate: int, *, colors: int = 0, **how: Any
) -> int:
    from PIL import Image as Pictures

    every = (Pictures.fromarray(picture) for picture in pictures)
    first, *others = (one.quantize(colors) if colors else one for one in every)
    kind, pause = "GIF" if colors else "WEBP", 1000 // rate
    first.save(path, kind, save_all=True, append_images=others, duration=pause, loop=0, **how)
    return 1 + len(others)
