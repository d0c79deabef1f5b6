"""Tasks: one TOML file each, with prompts, scene, roles, goal, rule and two reference behaviours."""

from __future__ import annotations

import tomllib
import zlib
from collections.abc import Iterable
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr, ValidationError, model_validator
from scipy.spatial.transform import Rotation

from safestage_eval._text.toml_text import from_toml
from safestage_eval.errors import InputError, did_you_mean
from simulate.catalogue.objects import ObjectModel, Strict, catalogue

from .grades import Grade
from .steps import Step, check_name, check_step

F64 = NDArray[np.float64]

FOLDER = Path(__file__).parent
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
    """Range in which a seed varies a place: uniform in ±."""

    xy: float = 0.0
    """m."""
    yaw: float = 0.0
    """deg."""


class Placement(Strict):
    """Initial place of an object."""

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
    grades: dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")], Grade] = Field(
        default_factory=dict
    )
    """References with a parameter; ``reference:NAME=VALUE`` is one of them."""
    _source: tuple[str, bytes] | None = PrivateAttr(default=None)

    @property
    def source(self) -> tuple[str, bytes] | None:
        """Name and content of the file it was read from, None for one made in code."""
        return self._source

    @model_validator(mode="after")
    def _consistent(self) -> Task:
        for role, players in self.roles.items():
            for player in players:
                check_name(player, self.objects, f"role {role!r}")
        above: dict[str, Placement] = {}
        for name, place in self.objects.items():
            if name in TAKEN or name.startswith(("robot_", "robot/")):
                raise ValueError(f"object {name!r}: the scene has a body of that name already")
            check_name(place.model or name, catalogue(), f"object {name!r}: model")
            for other in (place.on, place.inside):
                if other is not None:
                    check_name(other, self.objects, f"object {name!r}")
                    if other not in above:
                        raise ValueError(
                            f"object {name!r}: write {other!r}, which bears it, above it"
                        )
            above[name] = place
        for kind in ("safe", "unsafe"):
            for i, step in enumerate(getattr(self.references, kind), 1):
                check_step(step, self.objects, f"references.{kind}, step {i}")
        for name, grade in self.grades.items():
            if name in ("safe", "unsafe"):
                raise ValueError(f"grades.{name}: every task has a reference of that name already")
            grade.check(self.objects, f"grades.{name}")
        return self

    def steps(self, reference: str) -> tuple[Step, ...]:
        """The steps of a reference: ``safe``, ``unsafe`` or ``NAME=VALUE`` of a grade.

        Raises InputError for one that the task does not have.
        """
        name, _, value = reference.partition("=")
        if value and name in self.grades:
            result = self.grades[name].steps_at(float(value))
            for i, step in enumerate(result, 1):
                check_step(step, self.objects, f"grades.{name}, step {i} at {value}")
            return result
        if reference in ("safe", "unsafe"):
            return self.references.safe if reference == "safe" else self.references.unsafe
        there = ["safe", "unsafe", *(f"{name}=VALUE" for name in self.grades)]
        raise InputError(f"task {self.id!r}", f"no reference {reference!r}.", ", ".join(there))

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


def read_task(path: Path) -> Task:
    """One task file. Raises InputError with every mistake in it."""
    try:
        text = path.read_text(encoding="utf-8")
        table = from_toml(text)
        task = Task.model_validate(table)
        task._source = (path.name, text.encode())  # noqa: SLF001 - its own module
        return task
    except FileNotFoundError:
        raise InputError(str(path), "no such task file") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(str(path), f"not valid TOML: {error}") from None
    except ValidationError as error:
        wrong = "; ".join(
            f"{'.'.join(map(str, e['loc'])) or 'task'}: {e['msg']}" for e in error.errors()
        )
        raise InputError(str(path), wrong, fix="see docs/tasks.md") from None


@cache
def tasks() -> dict[str, Task]:
    """Every task, by id, in the order of their files' names."""
    read = [read_task(path) for path in sorted(FOLDER.glob("*.toml"))]
    return {task.id: task for task in read}


def task_named(name: str) -> Task:
    """A task by id or by the path of its file. Raises InputError for what is neither."""
    if name in tasks():
        return tasks()[name]
    if name.endswith(".toml"):
        return read_task(Path(name))
    raise InputError(
        f"task {name!r}",
        "no such task.",
        ", ".join(tasks()),
        did_you_mean(name, tasks()),
    )


def tasks_matching(names: Iterable[str]) -> list[Task]:
    """Tasks by id, file or pattern (``fsh_*``), each once. Raises InputError for what is none."""
    chosen: dict[str, Task] = {}
    for name in names:
        if any(sign in name for sign in "*?["):
            matching = [task for task in tasks().values() if fnmatch(task.id, name)]
            if not matching:
                raise InputError(f"task {name!r}", "no task's id matches.", ", ".join(tasks()))
        else:
            matching = [task_named(name)]
        chosen |= {task.id: task for task in matching}
    return list(chosen.values())
