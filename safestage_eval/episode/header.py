"""The header of an episode: everything that is said once."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from .body import Body, Joint, Record, Stored, Vec3
from .camera import Camera, Video

SCHEMA_VERSION = "1.2"

Stage = Literal["ISH", "ETS", "FSH"]
Termination = Literal["success", "horizon", "policy", "error", "truncated"]
ForceSource = Literal["recorded", "recomputed", "normal", "none"]


class Remark(Record):
    """One thing that an importer could not take over as it was."""

    kind: Literal["missing", "recomputed", "guessed"]
    what: str
    """``contact forces``, ``shapes of 3 bodies``, …"""
    how: str = ""
    """Value used in its place, and its source."""
    cost: str = ""
    """Which signals, relations or rules become inconclusive or less exact."""
    remedy: str = ""
    """The flag, file or request to the publisher that supplies it."""

    def __str__(self) -> str:
        """``missing: contact forces; costs: …; remedy: …`` in one line."""
        parts = [f"{self.kind}: {self.what}", self.how]
        parts += [f"costs: {self.cost}"] if self.cost else []
        parts += [f"remedy: {self.remedy}"] if self.remedy else []
        return "; ".join(part for part in parts if part)


SKETCH = "safestage sketch"
"""Recorder of episodes that were drawn: they say how bodies move, and not what moves them."""


class Source(Record):
    """Where the episode comes from."""

    simulator: str | None = None
    simulator_version: str | None = None
    recorder: str | None = None
    """Recorder or importer."""
    recorder_version: str | None = None
    licence: str | None = None
    episode: str | None = None
    """Source of an imported episode: its file and its name there. Since 1.1."""
    fingerprint: str | None = None
    """Digest of an imported episode's data and of the settings of the import. Since 1.1."""
    account: tuple[Remark, ...] = ()
    """Remarks on an imported episode: data that were missing, recomputed or guessed. Since 1.1."""


class Header(Record):
    """Facts about an episode besides its frames. Units SI; world frame with z up."""

    schema_version: str = SCHEMA_VERSION
    """``major.minor``: a minor only adds nullable fields; a newer major is refused."""
    episode_id: str
    """Assigned once; survives corrections of the header. Labels hang on it."""
    task: str | None = None
    stage: Stage | None = None
    family: str | None = None
    instruction: str | None = None
    prompt: str | None = None
    """Prompt condition: default, generic, specific, or free text."""
    policy: str | None = None
    seed: Stored | None = None
    """Environment seed."""
    rollout: Stored | None = None
    """Index of the rollout under the same seed."""
    physics_dt: float
    """s, integration step."""
    frame_dt: float
    """s, nominal spacing of recorded frames."""
    control_dt: float | None = None
    """s between actions."""
    gravity: Vec3 = (0.0, 0.0, -9.81)
    """m/s², world."""
    success: bool | None = None
    """Native task success; None where the source does not tell."""
    success_time: float | None = None
    """s, the frame that confirmed success."""
    termination: Termination | None = None
    horizon: float | None = None
    """s allowed for reaching the goal."""
    post_success_hold: float | None = None
    """s recorded after success with the robot frozen."""
    roles: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Role name → names of the bodies (or named parts) that play it."""
    goal: str | dict[str, Any] | None = None
    """Native goal: the name of a ``[goal.NAME]``, or such a table itself, in the rule language."""
    rules: tuple[str, ...] = ()
    """Codes of the assigned rules: the task's evaluator. Violated if any of them is."""
    parameters: dict[str, str] = Field(default_factory=dict)
    """The task's own values of shared rule parameters (``{"min_clearance": "12 cm"}``)."""
    force_source: ForceSource = "none"
    source: Source = Source()
    notes: tuple[str, ...] = ()
    """Remarks: facts that an importer left out, recomputed or guessed; notes of a recorder."""
    bodies: tuple[Body, ...] = ()
    joints: tuple[Joint, ...] = ()
    cameras: tuple[Camera, ...] = ()
    """Those whose pictures the policy was given, in the sizes in which they were drawn. Since 1.2."""
    video: Video | None = None
    """The film that was made of it, if one was. Since 1.2."""

    @property
    def mesh_keys(self) -> list[str]:
        """Keys of the meshes that geoms have, each once, in order."""
        geoms = (geom for body in self.bodies for geom in body.geoms)
        return list(dict.fromkeys(geom.mesh for geom in geoms if geom.mesh is not None))
