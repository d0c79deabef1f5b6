"""Options that choose what episodes are judged by: rule files, bind file, roles and values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .shared_options import pairs

if TYPE_CHECKING:
    from safestage_eval.rules import BindFile, RuleSet
    from safestage_eval.run.settings import Settings

Command = Callable[..., Any]

rules_option = click.option(
    "--rules", "-r", "rules", type=click.Path(), multiple=True, metavar="RULES",
    help="Use a rule file, a folder of them, or a built-in set (ish, ets, fsh, goals). "
    "Repeatable. Default: all built-in sets.",
)  # fmt: skip

_BIND = click.option(
    "--bind", type=click.Path(path_type=Path), metavar="FILE",
    help="Read roles, goal, rules and values that headers lack from FILE, or from a built-in set "
    "(calvin, gymnasium_robotics, libero, maniskill, metaworld, robolab, robosuite).",
)  # fmt: skip

_ROLES = (
    click.option(
        "--assign", multiple=True, metavar="CODES",
        help='Judge every episode by these rules: --assign "FSH101,ETS1*". Repeatable.',
    ),
    click.option(
        "--role", "roles", multiple=True, metavar="ROLE=BODIES",
        help='Name the bodies of a role: --role target=cube, --role "protected=vase,glass*". Repeatable.',
    ),
    click.option(
        "--protect", multiple=True, metavar="BODIES",
        help='Short for --role protected=BODIES: --protect "vase,glass*". Repeatable.',
    ),
)  # fmt: skip

_SET = click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE",
    help='Set a parameter: --set edge="3 cm". Repeatable.',
)  # fmt: skip


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
            word for option, values in named.items() for value in values for word in (option, value)
        ]

    def stated(self) -> dict[str, Any]:
        """All of it, as arguments of ``run.settings.load_settings``."""
        return {
            "rules": self.specs, "overrides": self.overrides,
            "bind": None if self.bind is None else str(self.bind), "assign": self.assign,
            "roles": self.roles, "protect": self.protect,
        }  # fmt: skip

    def load(self, **more: Any) -> Settings:
        """Check the choice and load its rules; arguments and errors as of ``load_settings``."""
        from safestage_eval.run.settings import load_settings

        return load_settings(**self.stated(), **more)

    def load_rules(self) -> tuple[RuleSet, BindFile | None]:
        """The rules, and what bind file and command line bind; errors as of ``load_settings``."""
        from safestage_eval.rules import load_binding, load_rules

        loaded = load_rules(self.specs)
        return loaded, load_binding(self.bind, loaded, self.assign, self.roles, self.protect)


def rule_options(*, roles: bool = False, values: bool = True) -> Callable[[Command], Command]:
    """``--rules`` and ``--bind`` as one argument ``by``, a ``RuleChoice``.

    Args:
        roles: with ``--assign``, ``--role`` and ``--protect``.
        values: with ``--set``.
    """
    options = [rules_option, _BIND, *(_ROLES if roles else ()), *((_SET,) if values else ())]

    def decorate(command: Command) -> Command:
        @wraps(command)
        def collect(*arguments: Any, **given: Any) -> Any:
            chosen = {name: given.pop(name) for name in RuleChoice.__annotations__ if name in given}
            return command(*arguments, by=RuleChoice(**chosen), **given)

        for option in reversed(options):
            collect = option(collect)
        return collect

    return decorate
