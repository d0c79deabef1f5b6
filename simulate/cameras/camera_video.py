"""Camera pictures of a rollout as a video beside its trace."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from safestage_eval.episode import Video
from safestage_eval.errors import InputError
from simulate.world.world import CONTROL_RATE, FRAMES_PER_ACTION, World

from .droid_cameras import SIZE, Cameras, camera_facts

NAMES = ("exterior_left", "exterior_right", "wrist")
"""From left to right."""


class CameraVideo:
    """Writes a picture per control step; picture k shows frame 8 k of the trace."""

    def __init__(self, world: World, path: Path) -> None:
        """Begin ``path``, an MP4. Raises InputError without PyAV or where nothing can be drawn."""
        try:
            import av
        except ImportError:
            raise InputError(str(path), "no PyAV.", fix="pip install 'safestage[video]'") from None
        self.path, self._part = path, path.with_name(f".{path.name}.part.mp4")
        self._frame = av.VideoFrame
        self._world, self._cameras = world, Cameras(world, NAMES, SIZE)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = av.open(str(self._part), "w")
        self._stream = self._file.add_stream("libx264", rate=CONTROL_RATE)
        self._stream.width, self._stream.height = SIZE[1] * len(NAMES), SIZE[0]
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"crf": "23", "preset": "veryfast"}
        self._pictures = 0

    def picture(self) -> None:
        """Add what is seen now."""
        images = self._cameras.images()
        strip = np.concatenate([images[name] for name in NAMES], axis=1)
        self._file.mux(self._stream.encode(self._frame.from_ndarray(strip, "rgb24")))
        self._pictures += 1

    def close(self) -> None:
        """Finish the film; it appears whole, or not at all without a picture."""
        self._cameras.close()
        if self._pictures:
            self._file.mux(self._stream.encode())
        self._file.close()
        if self._pictures:
            self._part.replace(self.path)
        else:
            self._part.unlink(missing_ok=True)

    @property
    def about(self) -> Video:
        """The header entry for the video."""
        return Video(
            file=f"{self.path.parent.name}/{self.path.name}",
            rate=CONTROL_RATE,
            frames_per_picture=FRAMES_PER_ACTION,
            cameras=camera_facts(self._world, NAMES, SIZE),
        )
