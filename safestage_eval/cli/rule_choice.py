"""Options that choose what episodes are judged by: rule files, bind file, roles and values."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .command_options import Declared, option
from .shared_options import pairs

if TYPE_CHECKING:
    from safestage_eval.rules import BindFile, RuleSet
    from safestage_eval.run.settings import Settings

rules_option = option(
    "Use a rule file, a folder of them, or a built-in set (ish, ets, fsh, goals). Repeatable. "
    "Default: all built-in sets.",
    "--rules", "-r", of=click.Path(), metavar="RULES",
)  # fmt: skip

OPTIONS = {
    "rules": rules_option,
    "bind": option(
        "Read roles, goal, rules and values that headers lack from FILE, or from a built-in set "
        "(calvin, gymnasium_robotics, libero, maniskill, metaworld, robolab, robosuite).",
        metavar="FILE",
    ),
    "assign": option(
        'Judge every episode by these rules: --assign "FSH101,ETS1*". Repeatable.', metavar="CODES"
    ),
    "roles": option(
        'Name the bodies of a role: --role target=cube, --role "protected=vase,glass*". Repeatable.',
        "--role", metavar="ROLE=BODIES",
    ),
    "protect": option(
        'Short for --role protected=BODIES: --protect "vase,glass*". Repeatable.', metavar="BODIES"
    ),
    "settings": option(
        'Set a parameter: --set edge="3 cm". Repeatable.', "--set", metavar="NAME=VALUE"
    ),
}  # fmt: skip
"""Attribute of ``RuleChoice`` → its option."""


@dataclass(frozen=True)
class RuleChoice:
    """The choices of a command line about what judges. False where it chooses nothing.

    Attributes:
        rules: paths, folders or built-in names, as given.
        bind: the bind file.
        assign, roles, protect: as ``rules.command_binding`` reads them.
        settings: ``NAME=VALUE``.
    """

    rules: tuple[str, ...] = ()
    bind: Path | None = None
    assign: tuple[str, ...] = ()
    roles: tuple[str, ...] = ()
    protect: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self != RuleChoice()

    @property
    def specs(self) -> list[str]:
        """The rule files; all built-in ones where none is named."""
        from safestage_eval.rules import builtin_names

        return list(self.rules) or builtin_names()

    @property
    def overrides(self) -> dict[str, str]:
        """Parameter → value as written."""
        return pairs(self.settings, "--set")

    def binding_options(self) -> list[str]:
        """The options that say which bodies and rules are meant, to be given to another command."""
        bind = () if self.bind is None else (str(self.bind),)
        named = {
            "--rules": self.rules, "--bind": bind, "--assign": self.assign, "--role": self.roles,
            "--protect": self.protect,
        }  # fmt: skip
        return [
            word for name, values in named.items() for value in values for word in (name, value)
        ]

    def load(self, **more: Any) -> Settings:
        """Check the choice and load its rules; arguments and errors as of ``load_settings``."""
        from safestage_eval.run.settings import load_settings

        bind = None if self.bind is None else str(self.bind)
        return load_settings(
            self.specs, overrides=self.overrides, bind=bind, assign=self.assign, roles=self.roles,
            protect=self.protect, **more,
        )  # fmt: skip

    def load_rules(self) -> tuple[RuleSet, BindFile | None]:
        """The rules, and what bind file and command line bind; errors as of ``load_settings``."""
        from safestage_eval.rules import load_binding, load_rules

        loaded = load_rules(self.specs)
        return loaded, load_binding(self.bind, loaded, self.assign, self.roles, self.protect)


class _RuleOptions(Declared):
    """Several options that are one argument of a function: a ``RuleChoice``."""

    def __init__(self, names: list[str]) -> None:
        self._chosen = names

    def parameters(self, *_: str) -> list[click.Parameter]:
        kinds = {field.name: str(field.type) for field in fields(RuleChoice)}
        return [
            parameter
            for name in self._chosen
            for parameter in OPTIONS[name].parameters(name, kinds[name])
        ]

    def taken(self, _: str, given: dict[str, Any]) -> RuleChoice:
        return RuleChoice(**{name: given.pop(name) for name in self._chosen})


def rule_options(*, roles: bool = False, values: bool = True) -> Any:
    """``--rules`` and ``--bind`` as one argument ``by``, a ``RuleChoice``.

    ``roles``: with ``--assign``, ``--role`` and ``--protect``; ``values``: with ``--set``.
    """
    left_out = ({"assign", "roles", "protect"} if not roles else set()) | (
        {"settings"} if not values else set()
    )
    return _RuleOptions([name for name in OPTIONS if name not in left_out])
