"""One benchmark task: its scene, its words, its goal, and how it can be done safely and unsafely."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from .errors import SceneError
from .objects import Entry, catalogue, parse

FOLDER = Path(__file__).parent / "tasks"
PROMPTS = ("default", "generic", "specific")
TABLE = "table"

Stage = Literal["ISH", "ETS", "FSH"]


class Prompts(Entry):
    """The instruction under the three prompt conditions; the objective is the same in all."""

    default: str
    generic: str
    specific: str


class Placed(Entry):
    """An object of the scene and where it stands at the start."""

    kind: str
    """Row of the object catalogue."""
    on: str = TABLE
    """What it stands on or in: the table, or an object listed before it."""
    at: tuple[float, float]
    """m, x and y in the world; relative to the supporting object's origin unless ``on`` the table."""
    yaw: float = 0.0
    """degrees about z."""
    jitter: tuple[float, float] = (0.0, 0.0)
    """m, half ranges of the per-seed shift in x and y (for objects on the table)."""
    jitter_yaw: float = 0.0
    """degrees, half range of the per-seed turn."""


class Spot(Entry):
    """A place named by what is there: a point above or on an object, or the table."""

    on: str = TABLE
    offset: tuple[float, float] = (0.0, 0.0)
    """m, x and y from the origin of ``on`` (from the world's origin for the table)."""
    height: float = 0.0
    """m of the moved object's lowest point above the surface of ``on``."""


class Step(Entry):
    """One skill of a reference behaviour with its arguments; ``simulate.skills`` tells which."""

    skill: Literal["pick", "carry", "place", "drop", "push", "wait", "home"]
    object: str | None = None
    grasp: str | None = None
    to: Spot | None = None
    via: tuple[Spot, ...] = ()
    lift: float = 0.12
    """m, how high ``pick`` lifts."""
    speed: float = 0.22
    """m/s, mean along the path."""
    drift: tuple[float, float] = (0.0, 0.0)
    """m/s, horizontal motion at the moment ``drop`` lets go."""
    seconds: float = 0.5


class References(Entry):
    """The two behaviours that make the task count: both reach the goal, one of them safely."""

    safe: tuple[Step, ...]
    unsafe: tuple[Step, ...]


class Task(Entry):
    """One task file."""

    id: str
    stage: Stage
    family: str
    prompts: Prompts
    objects: dict[str, Placed]
    roles: dict[str, str | tuple[str, ...]]
    goal: str
    """Name of a ``[goal.NAME]`` of the rules."""
    rules: tuple[str, ...] = Field(min_length=1)
    """Codes of the assigned rules."""
    parameters: dict[str, str] = Field(default_factory=dict)
    substeps: Literal[1, 2, 4] = 1
    """Physics steps per recorded frame: 4 where things bounce or roll."""
    horizon: float = Field(60.0, gt=0, le=90)
    """s."""
    reference: References

    def instruction(self, prompt: str) -> str:
        """The words of a prompt condition.

        Raises:
            SceneError: no such condition.
        """
        if prompt not in PROMPTS:
            raise SceneError(f"task {self.id}", f"no prompt {prompt!r}.", ", ".join(PROMPTS))
        return str(getattr(self.prompts, prompt))

    @property
    def players(self) -> dict[str, tuple[str, ...]]:
        """Role → names of the objects that play it."""
        return {r: (p,) if isinstance(p, str) else p for r, p in self.roles.items()}


def names(folder: Path = FOLDER) -> tuple[str, ...]:
    """Ids of all tasks, sorted."""
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


def load_task(name: str, folder: Path = FOLDER) -> Task:
    """A task by its id, or by the path of its file.

    Raises:
        SceneError: no such task, not TOML, or a table that says something the schema does not know.
    """
    path = Path(name) if name.endswith(".toml") else folder / f"{name}.toml"
    if not path.is_file():
        raise SceneError(name, "no such task.", ", ".join(names(folder)), "safestage tasks list")
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise SceneError(str(path), f"not TOML: {error}.") from None
    task = parse(Task, table, str(path))
    for where, what, allowed in _mistakes(task, path.stem):
        raise SceneError(f"{path}: {where}", what, allowed)
    return task


def _mistakes(task: Task, stem: str) -> list[tuple[str, str, str]]:
    """Names that mean nothing: (where, what, allowed)."""
    found = []
    kinds = catalogue()
    if task.id != stem:
        found.append(("id", f"{task.id!r} is not the file's name.", stem))
    if not task.id.startswith(task.stage.lower() + "_"):
        found.append(("id", f"does not begin with its stage, {task.stage.lower()}_", ""))
    before = [TABLE]
    for name, placed in task.objects.items():
        if placed.kind not in kinds:
            found.append((f"objects.{name}.kind", f"no object {placed.kind!r}.", ", ".join(kinds)))
        if placed.on not in before:
            found.append((f"objects.{name}.on", f"{placed.on!r} stands not yet.", ", ".join(before)))
        before.append(name)
    for role, players in task.players.items():
        for player in players:
            if player not in before:
                found.append((f"roles.{role}", f"no object {player!r}.", ", ".join(before)))
    for which in ("safe", "unsafe"):
        for i, step in enumerate(getattr(task.reference, which)):
            found += [
                (f"reference.{which}[{i}].{key}", what, allowed)
                for key, what, allowed in _step_mistakes(task, step, before)
            ]
    return found


def _step_mistakes(task: Task, step: Step, known: list[str]) -> list[tuple[str, str, str]]:
    needs: dict[str, tuple[str, ...]] = {
        "pick": ("object",),
        "carry": ("object", "via"),
        "place": ("object", "to"),
        "drop": ("object", "to"),
        "push": ("object", "to"),
    }
    found = [(key, f"{step.skill} needs it", "") for key in needs.get(step.skill, ()) if not getattr(step, key)]
    if step.object is not None and step.object not in task.objects:
        found.append(("object", f"no object {step.object!r}.", ", ".join(task.objects)))
        return found
    if step.skill == "pick" and step.object is not None:
        kind: Any = catalogue().get(task.objects[step.object].kind)
        if kind and step.grasp and step.grasp not in kind.grasp:
            found.append(("grasp", f"{step.object} has no grasp {step.grasp!r}.", ", ".join(kind.grasp)))
        elif kind and not kind.grasp:
            found.append(("object", f"{step.object} cannot be gripped", ""))
    for spot in (*step.via, *((step.to,) if step.to else ())):
        if spot.on not in known:
            found.append(("on", f"no object {spot.on!r}.", ", ".join(known)))
    return found
