"""Read a sketch: the file, its knobs, its mistakes with their places, and the episode it draws."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.rules.diagnostic import Diagnostic, RuleErrors, rendered
from safestage_eval.rules.files import RuleFile, builtin_folder, parsed
from safestage_eval.rules.locate import Keys

from .build_sketch import BrokenSceneError, build
from .sketch_model import STEPS, Sketch, Step

NAME = re.compile(r"(?P<file>[A-Za-z0-9_./-]+?)(?:\((?P<knobs>[^()]*)\))?")
"""``carried_past`` or, with other values of its knobs, ``carried_past(gap = 7.9)``."""


class SketchError(InputError):
    """A sketch that cannot be drawn, with everything that is wrong with it.

    Attributes:
        diagnostics: at least one, in the order of lines. ``K1…`` not TOML, ``K2…`` a key or value,
            ``K3…`` what the scene lacks, ``K4…`` knobs.
    """

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        """Collect; the diagnostics are sorted."""
        self.diagnostics = sorted(diagnostics)
        count = len(self.diagnostics)
        super().__init__(
            self.diagnostics[0].path, f"{count} problem{'s' * (count != 1)} in the sketch."
        )
        self.args = (self.diagnostics,)

    def __str__(self) -> str:
        """Every diagnostic as rendered, then their number."""
        return "\n\n".join([*rendered(self.diagnostics), super().__str__()])


def resolve(name: str, folders: Iterable[Path] = ()) -> Episode:
    """Draw the episode of an example by its name, as rule files give it.

    Args:
        name: of a file ``NAME.toml``; ``name(knob = value, …)`` turns its knobs.
        folders: where to look before the built-in examples.

    Raises:
        InputError: there is no such example.
        SketchError: it cannot be drawn.
    """
    match = NAME.fullmatch(name.strip())
    if match is None:
        raise InputError(name, "not the name of an example.", "name, or name(knob = value, …)")
    places = [*folders, builtin_folder() / "examples"]
    for folder in places:
        path = folder / f"{match['file']}.toml"
        if path.is_file():
            return read(path, _turned(name, match["knobs"]))
    where = ", ".join(str(folder) for folder in places)
    raise InputError(name, f"no example {match['file']}.toml in {where}.")


def read(path: Path, knobs: Mapping[str, str] | None = None) -> Episode:
    """Draw the episode of a file. Raises SketchError, or InputError if it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"cannot be read: {error}.") from None
    turned = ", ".join(f"{knob} = {value}" for knob, value in (knobs or {}).items())
    return draw(text, str(path), f"{path.stem}({turned})" if turned else path.stem, knobs or {})


def draw(text: str, path: str, name: str, knobs: Mapping[str, str] | None = None) -> Episode:
    """Draw the episode of a sketch's text; ``path`` and ``name`` are what messages say."""
    try:
        table = parsed(text, path)[1]
    except RuleErrors as error:
        raise SketchError([replace(one, code="K101") for one in error.diagnostics]) from None
    page = _Page(RuleFile(path, text, table, asked=True))
    declared = table.get("knobs", {})
    values = {k: str(v) for k, v in declared.items()} if isinstance(declared, dict) else {}
    for knob, value in (knobs or {}).items():
        if knob not in values:
            page.report("K401", ("knobs",), f"there is no knob {knob!r}", ", ".join(declared))
        else:
            values[knob] = value
    table = {k: v if k == "knobs" else page.filled((k,), v, values) for k, v in table.items()}
    for knob in sorted(set(values) - page.used):
        page.report("K402", ("knobs", knob), f"nothing in the file uses {{{knob}}}")
    sketch = page.validated(Sketch, table, ())
    steps = [page.step(i, item) for i, item in enumerate(table.get("story", ()))]
    if page.problems or sketch is None:
        raise SketchError(page.problems)
    try:
        return build(sketch, [step for step in steps if step is not None], name)
    except BrokenSceneError as error:
        page.report("K301", error.keys, str(error))
        raise SketchError(page.problems) from None


class _Page:
    """A file being read; collects its mistakes."""

    def __init__(self, file: RuleFile) -> None:
        self.file = file
        self.problems: list[Diagnostic] = []
        self.used: set[str] = set()

    def report(self, code: str, keys: Keys, message: str, allowed: str = "") -> None:
        self.problems.append(self.file.diagnostic(code, keys, message, allowed, key=False))

    def filled(self, keys: Keys, value: Any, knobs: Mapping[str, str]) -> Any:
        """Replace every {knob} in the strings of a value."""
        if isinstance(value, dict):
            return {k: self.filled((*keys, k), v, knobs) for k, v in value.items()}
        if isinstance(value, list):
            return [self.filled((*keys, i), v, knobs) for i, v in enumerate(value)]
        if not isinstance(value, str):
            return value
        for knob in re.findall(r"\{(\w+)\}", value):
            self.used.add(knob)
            if knob not in knobs:
                self.report("K403", keys, f"there is no knob {knob!r}", ", ".join(knobs))
            value = value.replace(f"{{{knob}}}", knobs.get(knob, "0"))
        return {"false": False, "true": True}.get(value, value)

    def validated(self, model: type[Any], table: Any, keys: Keys) -> Any:
        try:
            return model.model_validate(table)
        except ValidationError as error:
            for one in error.errors(include_url=False):
                place = (*keys, *one["loc"])
                message = one["msg"].removeprefix("Value error, ")
                allowed = ""
                if one["type"] == "extra_forbidden":
                    message, allowed = (
                        f"there is no key {place[-1]!r} here",
                        ", ".join(model.model_fields if len(one["loc"]) == 1 else ()),
                    )
                self.report("K201", place, message, allowed)
            return None

    def step(self, index: int, item: Any) -> Step | None:
        verbs = [verb for verb in STEPS if isinstance(item, dict) and verb in item]
        if not verbs:
            self.report("K202", ("story", index), "no step: it has no verb", ", ".join(STEPS))
            return None
        verb = next(key for key in item if key in verbs)
        step: Step | None = self.validated(STEPS[verb], item, ("story", index))
        return step


def _turned(name: str, text: str | None) -> dict[str, str]:
    knobs = {}
    for item in (text or "").split(","):
        knob, equals, value = item.partition("=")
        if item.strip() and not equals:
            raise InputError(name, f"{item.strip()!r} turns no knob.", "knob = value")
        if equals:
            knobs[knob.strip()] = value.strip()
    return knobs
