"""Commands that say once what they take: as the defaults of a function's parameters.

    @command("slack")
    def command(rows: str, params: tuple[str, ...] = option("Show only this parameter.", "--param", "-p")) -> None: …

A parameter without a default is an argument of its name. The annotation says the rest: ``bool`` is a flag,
``tuple[…]`` may be repeated, and ``int``, ``float`` and ``Path`` are the types of values. The function returns the
exit code.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import click

from safestage_eval.units import LONGEST

Function = Callable[..., Any]

TYPES: dict[str, Any] = {"int": int, "float": float, "Path": click.Path(path_type=Path)}


class Declared:
    """An option or argument of the command line, declared as a parameter's default."""

    def __init__(self, kind: type[click.Parameter], names: Sequence[str], **settings: Any) -> None:
        """``settings``: passed to click, in addition to what follows from the annotation."""
        self._kind, self._names, self._settings = kind, names, settings

    def parameters(self, name: str, annotation: str) -> list[click.Parameter]:
        """Return the click parameters that it declares."""
        several = annotation.startswith("tuple[")
        plain = annotation.removesuffix(" | None").removeprefix("tuple[").removesuffix(", ...]")
        said: dict[str, Any] = {"type": TYPES[plain]} if plain in TYPES else {}
        names = [name, *self._names]
        if self._kind is click.Argument:
            said |= {"nargs": -1} if several else {}
        else:
            said |= {"is_flag": True} if plain == "bool" else {"multiple": several}
            if not any(each.startswith("--") for each in names):
                names.append(f"--{name.replace('_', '-')}")
        return [self._kind(names, **(said | self._settings))]

    def taken(self, name: str, given: dict[str, Any]) -> Any:
        """Remove the function's argument from the values that click gives, and return it."""
        return given.pop(name)


def option(
    text: str,
    *names: str,
    of: Any = None,
    least: int | None = None,
    most: int | None = None,
    **more: Any,
) -> Any:
    """Declare an option, with its help; ``names`` other than its parameter's: ``-o``, ``--param``.

    ``of``: a type of click, or choices; ``least``, ``most``: of a whole number.
    """
    if isinstance(of, tuple):
        of = click.Choice(of)
    if least is not None or most is not None:
        of = click.IntRange(least, most)
    if of is not None:
        more["type"] = of
    shown = more.get("default") not in (None, "") and not isinstance(more["default"], bool)
    return Declared(click.Option, names, help=text, **{"show_default": shown, **more})


def argument(metavar: str, **more: Any) -> Any:
    """Declare an argument."""
    return Declared(click.Argument, (), metavar=metavar, **more)


def command(
    name: str, *, advanced: Sequence[str] = (), **settings: Any
) -> Callable[[Function], click.Command]:
    """The command of a function.

    ``advanced``: names of parameters that only ``--help-all`` shows.
    """

    def make(function: Function) -> click.Command:
        declared: dict[str, Declared] = {}
        parameters: list[click.Parameter] = []
        for own, parameter in inspect.signature(function).parameters.items():
            plain = parameter.default is parameter.empty
            declared[own] = Declared(click.Argument, ()) if plain else parameter.default
            parameters += declared[own].parameters(own, str(parameter.annotation))

        @wraps(function)
        def call(**given: Any) -> None:
            code = function(**{own: each.taken(own, given) for own, each in declared.items()})
            if code:
                click.get_current_context().exit(code)

        parameters += [_HELP_ALL] if advanced else []
        text = inspect.cleandoc(function.__doc__ or "")
        made = _Folded(name, params=parameters, callback=call, help=text, **settings)
        made.advanced = frozenset((*advanced, "limits") if advanced else ())
        return made

    return make


class _Folded(click.Command):
    """Shows few options in ``--help``, all of them in ``--help-all``."""

    advanced: frozenset[str] = frozenset()

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Leave out what is advanced, unless it is asked for."""
        left_out = frozenset[str]() if "help-all" in ctx.meta else self.advanced
        shown = [
            record
            for parameter in self.get_params(ctx)
            if isinstance(parameter, click.Option) and parameter.name not in left_out
            if (record := parameter.get_help_record(ctx))
        ]
        with formatter.section("Options"):
            formatter.write_dl(shown)


def _show_all(ctx: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked:
        ctx.meta["help-all"] = True
        click.echo(ctx.get_help())
        ctx.exit()


_HELP_ALL = click.Option(
    ["--help-all"], is_flag=True, is_eager=True, expose_value=False, callback=_show_all,
    help="Show all options.",
)  # fmt: skip


def prepared(command: click.Command) -> click.Command:
    """A command, and those below it, with ``--limits``, finite numbers, and no output that destroys something."""
    from .outputs import refusing_outputs

    if isinstance(command, click.Group):
        for below in command.commands.values():
            prepared(below)
    elif _LIMITS not in command.params:
        for parameter in command.params:
            _refuse_infinite(parameter)
        command.params.append(_LIMITS)
        assert command.callback is not None
        command.callback = refusing_outputs(command.callback)
    return command


def _refuse_infinite(parameter: click.Parameter) -> None:
    """Make the parameter refuse NaN, infinity and numbers beyond any use, if it takes numbers."""
    if not isinstance(parameter.type, click.types.IntParamType | click.types.FloatParamType):
        return
    most = LONGEST if isinstance(parameter.type, click.types.FloatParamType) else 2**63 - 1
    usual = parameter.callback

    def checked(context: click.Context, option: click.Parameter, value: Any) -> Any:
        for number in value if isinstance(value, tuple) else (value,):
            if number is not None and not abs(number) <= most:
                raise click.BadParameter(f"too large, or not finite; {most:.0g} at most")
        return value if usual is None else usual(context, option, value)

    parameter.callback = checked


def _set_limits(_context: click.Context, _option: click.Parameter, text: str | None) -> None:
    from safestage_eval.errors import InputError
    from safestage_eval.size_limits import VARIABLE, parse_limits

    if text is None:
        return
    try:
        parse_limits(text)
    except InputError as error:
        raise click.UsageError(str(error)) from None
    os.environ[VARIABLE] = text


_LIMITS = click.Option(
    ["--limits"], metavar="NAME=NUMBER,...", expose_value=False, is_eager=True, callback=_set_limits,
    help="Read larger episodes: bodies=10000,decoded=1GB, or none (docs/security.md).",
)  # fmt: skip
"""Option of every command; worker processes inherit what it sets."""
