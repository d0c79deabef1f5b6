"""Tasks: one TOML file each, with prompts, scene, roles, goal, rule and two reference behaviours."""

from __future__ import annotations

import difflib
import inspect
import tomllib
import zlib
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    create_model,
    model_validator,
)
from scipy.spatial.transform import Rotation

from safestage_eval.errors import InputError

from .objects import ObjectModel, Strict, catalogue
from .skills import SKILLS

F64 = NDArray[np.float64]

FOLDER = Path(__file__).parent / "tasks"
TAKEN = ("world", "table", "floor")
"""Names of bodies that every scene has."""
GAP = 2e-4
"""m between what is stacked when a scene is laid out; it settles before the first frame."""


class Prompts(Strict):
    """The three instruction conditions; the objective never changes."""

    default: str
    generic: str
    specific: str


class Jitter(Strict):
    """How much a seed may vary a place: uniform in ±."""

    xy: float = 0.0
    """m."""
    yaw: float = 0.0
    """deg."""


class Placement(Strict):
    """Where an object starts."""

    model: str = ""
    """Name in ``catalogue/``; the object's own name where empty."""
    position: tuple[float, float]
    """m: on the table, from the robot's base; on or in another object, from its origin."""
    yaw: float = 0.0
    """deg about z."""
    pitch: float = 0.0
    """deg about its own y, after its yaw: for what leans or lies on its side."""
    roll: float = 0.0
    """deg about its own x, after yaw and pitch."""
    raised: float = 0.0
    """m, its origin above the surface: what leans or lies does not stand on its origin."""
    on: str | None = None
    """Name of the object it stands on; it moves with that one's jitter."""
    inside: str | None = None
    """Name of the container it lies in."""
    jitter: Jitter = Jitter()


class Step(Strict):
    """One skill of a reference; its arguments are those of the skill in ``skills/``."""

    model_config = Strict.model_config | {"extra": "allow"}

    skill: str

    @property
    def arguments(self) -> dict[str, Any]:
        """Everything but the skill's name."""
        return dict(self.__pydantic_extra__ or {})


class References(Strict):
    """Two ways to the same goal."""

    safe: tuple[Step, ...]
    unsafe: tuple[Step, ...]


class Task(Strict):
    """One task of the benchmark."""

    id: str
    stage: Literal["ISH", "ETS", "FSH"]
    family: str
    horizon: float = Field(ge=10, le=90)
    """s allowed for reaching the goal."""
    substeps: int = Field(default=1, ge=1, le=8)
    """Physics steps per 1/120 s."""
    prompts: Prompts
    roles: dict[str, tuple[str, ...]]
    goal: str
    """Name of a ``[goal.NAME]`` in rules/goals.toml."""
    rules: tuple[str, ...] = Field(min_length=1)
    """Codes of the assigned rules."""
    parameters: dict[str, str] = Field(default_factory=dict)
    objects: dict[str, Placement]
    references: References
    _source: tuple[str, bytes] | None = PrivateAttr(default=None)

    @property
    def source(self) -> tuple[str, bytes] | None:
        """Name and content of the file it was read from, None for one made in code."""
        return self._source

    @model_validator(mode="after")
    def _consistent(self) -> Task:
        for role, players in self.roles.items():
            for player in players:
                _known(player, self.objects, f"role {role!r}")
        above: dict[str, Placement] = {}
        for name, place in self.objects.items():
            if name in TAKEN or name.startswith(("robot_", "robot/")):
                raise ValueError(f"object {name!r}: the scene has a body of that name already")
            _known(place.model or name, catalogue(), f"object {name!r}: model")
            for other in (place.on, place.inside):
                if other is not None:
                    _known(other, self.objects, f"object {name!r}")
                    if other not in above:
                        raise ValueError(
                            f"object {name!r}: write {other!r}, which bears it, above it"
                        )
            above[name] = place
        for kind in ("safe", "unsafe"):
            for i, step in enumerate(getattr(self.references, kind), 1):
                _usable(step, self.objects, f"references.{kind}, step {i}")
        return self

    def models(self) -> dict[str, ObjectModel]:
        """Object name → what it is."""
        return {name: catalogue()[p.model or name] for name, p in self.objects.items()}

    def layout(self, seed: int) -> dict[str, tuple[F64, F64]]:
        """Object name → (position (3,) m, orientation (4,) wxyz) for an environment seed.

        The same seed always gives the same scene. Names are laid out in the file's order, so that
        what another stands on comes first.
        """
        rng = np.random.default_rng([seed, zlib.crc32(self.id.encode())])
        models = self.models()
        out: dict[str, tuple[F64, F64]] = {}
        yaws: dict[str, float] = {}
        for name, place in self.objects.items():
            dx, dy = rng.uniform(-1, 1, 2) * place.jitter.xy
            yaw = np.radians(place.yaw + rng.uniform(-1, 1) * place.jitter.yaw)
            x, y = place.position[0] + dx, place.position[1] + dy
            z = GAP + place.raised
            base = place.on or place.inside
            if base is not None:
                origin, turn = out[base][0], yaws[base]
                x, y = (
                    origin[0] + np.cos(turn) * x - np.sin(turn) * y,
                    origin[1] + np.sin(turn) * x + np.cos(turn) * y,
                )
                yaw += turn
                z += origin[2] + _floor_height(models[base], inside=place.inside is not None)
            yaws[name] = float(yaw)
            turn_to = Rotation.from_euler(
                "ZYX", [yaw, np.radians(place.pitch), np.radians(place.roll)]
            )
            out[name] = np.array([x, y, z]), turn_to.as_quat(canonical=True, scalar_first=True)
        return out


def _floor_height(model: ObjectModel, *, inside: bool) -> float:
    if inside and model.cavity is not None:
        return float(model.cavity.position[2] - model.cavity.size[-1])
    return model.height


def _known(name: str, among: dict[str, Any], where: str) -> None:
    if name not in among:
        near = difflib.get_close_matches(name, among, 1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        raise ValueError(f"{where}: no {name!r}{hint}; there are {', '.join(sorted(among))}")


def _usable(step: Step, objects: dict[str, Any], where: str) -> None:
    _known(step.skill, SKILLS, f"{where}: skill")
    allowed = ", ".join([*inspect.signature(SKILLS[step.skill]).parameters][1:])
    try:
        _arguments(step.skill).model_validate(step.arguments)
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise ValueError(f"{where}: {step.skill}: {wrong}; it takes {allowed}") from None
    for key in ("object", "on", "near"):
        if step.arguments.get(key) is not None:
            _known(step.arguments[key], objects, f"{where}: {key}")


@cache
def _arguments(skill: str) -> type[BaseModel]:
    """What checks the arguments of a skill: their names and types are those of its function."""
    hints, fields = get_type_hints(SKILLS[skill]), dict[str, Any]()
    for name, parameter in [*inspect.signature(SKILLS[skill]).parameters.items()][1:]:
        default = ... if parameter.default is parameter.empty else parameter.default
        fields[name] = (hints[name], default)
    return create_model(skill, __config__=ConfigDict(extra="forbid", strict=True), **fields)


def read_task(path: Path) -> Task:
    """One task file. Raises InputError with every mistake in it."""
    try:
        text = path.read_text(encoding="utf-8")
        table = tomllib.loads(text)
        task = Task.model_validate(table)
        task._source = (path.name, text.encode())  # noqa: SLF001 - its own module
        return task
    except FileNotFoundError:
        raise InputError(str(path), "no such task file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(path), f"not valid TOML: {error}") from None
    except ValidationError as error:
        wrong = "; ".join(
            f"{'.'.join(map(str, e['loc'])) or 'task'}: {e['msg']}" for e in error.errors()
        )
        raise InputError(str(path), wrong, fix="see docs/tasks.md") from None


@cache
def tasks() -> dict[str, Task]:
    """Every task, by id, in the order of their files' names."""
    found = [read_task(path) for path in sorted(FOLDER.glob("*.toml"))]
    return {task.id: task for task in found}


def task_named(name: str) -> Task:
    """A task by id or by the path of its file. Raises InputError for what is neither."""
    if name in tasks():
        return tasks()[name]
    if name.endswith(".toml"):
        return read_task(Path(name))
    near = difflib.get_close_matches(name, tasks(), 1)
    raise InputError(
        f"task {name!r}",
        "no such task.",
        ", ".join(tasks()),
        f"did you mean {near[0]!r}?" if near else "",
    )
