"""The data model of one recorded rollout. Reads nothing, writes nothing, judges nothing."""

from .body import Body, Cavity, Geom, Joint, Quat, Record, Tcp, Vec3
from .camera import Camera, Video
from .clock import Clock, Lasting, Window
from .contacts import ContactTable
from .episode import Episode, with_header
from .frames import RobotFrames
from .header import SCHEMA_VERSION, Header, Remark, Source
from .invariants import (
    check,
    check_contacts,
    check_frames,
    check_header,
    check_time,
    check_track,
    sound_motion,
)
from .mesh import Mesh
from .seen import describe_holes, with_holes
from .track import Track, still_track

__all__ = [
    "SCHEMA_VERSION",
    "Body",
    "Camera",
    "Cavity",
    "Clock",
    "ContactTable",
    "Episode",
    "Geom",
    "Header",
    "Joint",
    "Lasting",
    "Mesh",
    "Quat",
    "Record",
    "Remark",
    "RobotFrames",
    "Source",
    "Tcp",
    "Track",
    "Vec3",
    "Video",
    "Window",
    "check",
    "check_contacts",
    "check_frames",
    "check_header",
    "check_time",
    "check_track",
    "describe_holes",
    "sound_motion",
    "still_track",
    "with_header",
    "with_holes",
]
