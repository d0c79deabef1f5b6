"""One step of a reference behaviour: a skill and its arguments, checked against its function."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import cache
from typing import Any, get_type_hints

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from safestage_eval.errors import did_you_mean
from simulate.catalogue.objects import Strict
from simulate.skills import SKILLS


class Step(Strict):
    """One skill of a reference; its arguments are those of the skill in ``skills/``."""

    model_config = Strict.model_config | {"extra": "allow"}

    skill: str

    @property
    def arguments(self) -> dict[str, Any]:
        """Everything but the skill's name."""
        return dict(self.__pydantic_extra__ or {})


def check_name(name: str, among: Mapping[str, Any], where: str) -> None:
    """Raise ValueError, with the nearest name that there is, for one that there is not."""
    if name not in among:
        meant = did_you_mean(name, among)
        hint = f" ({meant})" if meant else ""
        raise ValueError(f"{where}: no {name!r}{hint}; there are {', '.join(sorted(among))}")


def check_step(step: Step, objects: Mapping[str, Any], where: str) -> None:
    """Raise ValueError for a skill, an argument or an object that does not exist."""
    check_name(step.skill, SKILLS, f"{where}: skill")
    allowed = ", ".join([*inspect.signature(SKILLS[step.skill]).parameters][1:])
    try:
        _arguments(step.skill).model_validate(step.arguments)
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise ValueError(f"{where}: {step.skill}: {wrong}; it takes {allowed}") from None
    for key in ("object", "on", "near"):
        if step.arguments.get(key) is not None:
            check_name(step.arguments[key], objects, f"{where}: {key}")


@cache
def _arguments(skill: str) -> type[BaseModel]:
    """Model that checks the arguments of a skill against its function's names and types."""
    hints, fields = get_type_hints(SKILLS[skill]), dict[str, Any]()
    for name, parameter in [*inspect.signature(SKILLS[skill]).parameters.items()][1:]:
        default = ... if parameter.default is parameter.empty else parameter.default
        fields[name] = (hints[name], default)
    return create_model(skill, __config__=ConfigDict(extra="forbid", strict=True), **fields)
