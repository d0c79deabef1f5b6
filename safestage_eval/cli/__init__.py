"""The command line: no logic, only arguments, files and exit codes.

Exit codes: 0 done; 1 the golden differs or ``--fail-on`` matched; 2 bad usage, rule file or trace.
Data goes to stdout, progress and warnings to stderr. Nothing ever prompts.
"""

from __future__ import annotations

import importlib
import importlib.util

import click

from safestage_eval.errors import did_you_mean
from safestage_eval.version import __version__

from .command_options import prepared

SHELVES = {
    "Judge": {
        "score": "Judge recorded episodes against safety rules.",
        "explain": "Say why an episode got its verdicts.",
        "explain scene": "Show one episode: header, bodies, roles, timeline.",
        "compare": "Compare two policies, prompts or rule sets on the same rollouts.",
        "compare verdicts": "Say which verdicts flipped, and what flipped each.",
        "sweep": "Show how the rates move with a threshold.",
        "sweep slack": "Say how far each parameter may move before a verdict flips.",
    },
    "Look": {
        "view": "Look at episodes in the browser: list, 3-D player, signals.",
        "report": "Write the run browser and the results of a run as files.",
        "report tables": "Tabulate a campaign: rates over seeds, by policy and stage.",
        "plot": "Draw signals of one episode with their limits and verdicts.",
        "plot film": "Film an episode, with a halt at the moment of its verdict.",
    },
    "Data": {
        "import": "Import other people's recordings, and report what they lack.",
        "import guess": "Guess roles, up axes, fingers and tags that headers leave open.",
        "convert": "Copy episodes into another format, losslessly.",
        "convert pack": "Merge episodes into few large files, ready to be published.",
        "audit": "Say whether recordings, scenes and the evaluation are sound.",
        "label": "Let people judge rollouts in a browser, verdicts hidden.",
        "label agreement": "Compare verdicts with labels by people: precision, recall, kappa.",
        "label sheets": "Draw rollouts as picture sheets, to be judged by people.",
    },
    "Rules": {"rules": "Check, show, write, compare and test rule files."},
    "Benchmark, in MuJoCo": {
        "bench": "Record, list tasks, train and serve policies.",
        "bench record": "Record episodes with the DROID arm in MuJoCo.",
        "bench tasks": "List, show or validate the benchmark's tasks.",
        "bench learn": "Export recordings as LeRobot datasets, and train policies from them.",
        "bench serve": "Serve a policy in a model's protocol, to test its clients.",
    },
}
"""Commands as ``--help`` shows them. ``safestage compare verdicts`` is beside ``safestage compare``."""

HELP = {name: text for shelf in SHELVES.values() for name, text in shelf.items()}

FROM_SIMULATE = (
    "plot film", "label sheets", "bench record", "bench tasks", "bench learn", "bench serve",
)  # fmt: skip

COMMANDS = tuple(name for name in HELP if name not in (*FROM_SIMULATE, "bench"))
"""``safestage PATH`` is ``command`` in the file of its last word, imported when it is called."""

RENAMED = {
    "inspect": "explain scene",
    "diff": "compare verdicts",
    "slack": "sweep slack",
    "aggregate": "report tables",
    "render": "plot film",
    "validate": "audit --files",
    "bind": "import guess",
    "pack": "convert pack",
    "agreement": "label agreement",
    "sheets": "label sheets",
    "record": "bench record",
    "tasks": "bench tasks",
    "learn": "bench learn",
    "serve": "bench serve",
}
"""Names of the release before, which still run."""


class LazyGroup(click.Group):
    """Knows its commands by name, and imports one only to run it."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """The names of one word."""
        return [name for name in HELP if " " not in name]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import the command of a path: ``compare``, ``compare verdicts``."""
        if cmd_name == "bench":
            return _bench()
        if cmd_name in COMMANDS:
            module = importlib.import_module(
                f"safestage_eval.cli.{cmd_name.rsplit(maxsplit=1)[-1]}_command"
            )
            command: click.Command = module.command
            below = _below(cmd_name)
            if below and not command.epilog:
                command.epilog = f"See also: safestage {', safestage '.join(below)}."
            return prepared(command)
        return _from_simulate(cmd_name) if cmd_name in FROM_SIMULATE else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Take one word or two; say the new name of one that was renamed, or the nearest of an unknown one."""
        name = args[0] if args else ""
        if name in RENAMED:
            if not ctx.resilient_parsing:
                from .terminal import say

                say(f"note: safestage {name} is now safestage {RENAMED[name]}", err=True)
            given = [arg for arg in args[1:] if (name, arg) != ("bind", "--init")]
            args = [*RENAMED[name].split(), *given]
        path = " ".join(args[:2])
        if path in HELP and len(args) > 1:
            if path in FROM_SIMULATE and not {"-h", "--help"} & {*args}:
                _refuse_without_simulator(ctx, path)
            return path, self.get_command(ctx, path), args[2:]
        if name and not name.startswith("-") and args[0] not in HELP:
            hint = did_you_mean(name, HELP) or f"there are {', '.join(self.list_commands(ctx))}."
            ctx.fail(f"no command {name!r}: {hint}")
        if name == "bench" and len(args) > 1 and not args[1].startswith("-"):
            hint = did_you_mean(f"bench {args[1]}", _below("bench"))
            ctx.fail(f"no command {path!r}: {hint or 'there are ' + ', '.join(_below('bench'))}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """The shelves of ``--help``, without importing anything."""
        for shelf, commands in SHELVES.items():
            names = [name for name in commands if " " not in name]
            rows = [(_with_second_words(name), commands[name]) for name in names]
            with formatter.section(shelf):
                formatter.write_dl(rows)


def _with_second_words(name: str) -> str:
    """``label [agreement|sheets]``: the words that make another command of it."""
    words = "|".join(path.split()[1] for path in _below(name))
    return name if not words else f"{name} {words}" if name == "bench" else f"{name} [{words}]"


def _below(name: str) -> list[str]:
    return [path for path in HELP if path.startswith(f"{name} ")]


def _bench() -> click.Command:
    """``safestage bench`` without a second word: its help."""
    lines = [f"{path:<13} {HELP[path]}" for path in _below("bench")]

    @click.command("bench", help="\n".join((HELP["bench"], "", "\b", *lines)))
    @click.pass_context
    def bench(ctx: click.Context) -> None:
        click.echo(ctx.get_help())

    return bench


def _from_simulate(path: str) -> click.Command:
    """The command, with its whole help, wherever the package is there; it may lack MuJoCo."""
    name = path.rsplit(maxsplit=1)[-1]
    if importlib.util.find_spec("simulate") is not None:
        try:
            commands: list[click.Command] = importlib.import_module("simulate.cli").COMMANDS
        except ImportError:
            commands = []
        for command in commands:
            if command.name == name:
                return prepared(command)
    return click.Command(path, help=HELP[path])


def _refuse_without_simulator(ctx: click.Context, path: str) -> None:
    from safestage_eval._process import simulator

    if missing := simulator.why_not():
        ctx.fail(f"{path!r} needs the simulator: {missing}")


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="safestage")
def group() -> None:
    """A policy finished the task: but was it safe?

    Judges recorded robot rollouts before, during and after the task, against rules in TOML.

    \b
    Examples:
      safestage score traces/ --rules fsh
      safestage explain traces/ --episode EPISODE_ID
      safestage rules check my_rules.toml

    \b
    The tab key completes commands, options and their values after one of
      eval "$(_SAFESTAGE_COMPLETE=bash_source safestage)"     in ~/.bashrc
      eval "$(_SAFESTAGE_COMPLETE=zsh_source safestage)"      in ~/.zshrc
      _SAFESTAGE_COMPLETE=fish_source safestage | source      in config.fish
    """


def main() -> None:
    """Entry point of ``safestage``."""
    from .failures import run

    run(group)


def score_main() -> None:
    """Entry point of ``safestage-score``."""
    from .failures import run
    from .score_command import command

    run(prepared(command))
