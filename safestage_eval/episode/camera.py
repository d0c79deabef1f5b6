"""Cameras that looked at an episode, and the film that may lie beside its trace."""

from __future__ import annotations

from .body import IDENTITY, ORIGIN, Quat, Record, Vec3


class Camera(Record):
    """A pinhole camera without distortion. It looks along its own −z; its x is right, its y up.

    A point (x, y, z) of its frame is seen at column ``cx − fx x / z`` and row ``cy + fy y / z``,
    counted in pixels from the upper left corner of the picture.
    """

    name: str
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    fx: float
    """Pixels, focal length along a row."""
    fy: float
    """Pixels, focal length along a column."""
    cx: float
    """Pixels, principal point from the left."""
    cy: float
    """Pixels, principal point from the top."""
    body: str | None = None
    """The body that carries it; None where it stands in the world."""
    position: Vec3 = ORIGIN
    """m, in the body's frame."""
    orientation: Quat = IDENTITY
    """wxyz, camera to body."""


class Video(Record):
    """A film of the episode. Picture k shows frame ``first_frame + k * frames_per_picture``."""

    file: str
    """Path from the folder that the trace is in."""
    rate: float
    """Pictures per second."""
    frames_per_picture: int
    first_frame: int = 0
    cameras: tuple[Camera, ...]
    """From left to right in each picture, each as wide as it says."""
