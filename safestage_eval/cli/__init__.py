"""The command line: no logic, only arguments, files and exit codes.

Exit codes: 0 done; 1 the golden differs or ``--fail-on`` matched; 2 bad usage, rule file or trace.
Data goes to stdout, progress and warnings to stderr. Nothing ever prompts.
"""

from __future__ import annotations

import importlib

import click

from safestage_eval.errors import did_you_mean
from safestage_eval.version import __version__

HELP = {
    "score": "Judge recorded episodes against safety rules.",
    "inspect": "Show one episode: header, bodies, roles, timeline.",
    "explain": "Say why an episode got its verdicts, one sentence per finding.",
    "view": "Look at episodes in the browser: list, 3-D player, signals.",
    "audit": "Say whether recordings, scenes and the evaluation are sound.",
    "validate": "Check trace files: are they whole, and as they were written?",
    "verify": "Verify results: recompute digests, judge a sample again.",
    "convert": "Copy an episode into another format, losslessly.",
    "pack": "Merge episodes into few large files, ready to be published.",
    "import": "Import other people's recordings, and report what they lack.",
    "bind": "Guess roles, up axes, fingers and tags that headers leave open.",
    "rules": "Check, explain, compare and test rule files.",
    "sweep": "Show how the rates move with a threshold.",
    "diff": "Say which verdicts flipped, and which parameter flipped each.",
    "slack": "Say how far each parameter may move before a verdict flips.",
    "aggregate": "Tabulate a campaign: rates as mean ± deviation over seeds.",
    "compare": "Compare two policies, prompts or rule sets on the same rollouts.",
    "report": "Write the run browser and the results of a run as files.",
    "label": "Let people judge rollouts in a browser, verdicts hidden.",
    "agreement": "Compare verdicts with labels by people: precision, recall, kappa.",
    "plot": "Draw signals of one episode with their limits and verdicts.",
    "record": "Record episodes with the DROID arm in MuJoCo.",
    "tasks": "List, show or validate the benchmark's tasks.",
    "render": "Film an episode, with a halt at the moment of its verdict.",
    "sheets": "Draw rollouts as picture sheets, to be judged by people.",
    "serve": "Serve a policy in a model's protocol, to test its clients.",
    "learn": "Export recordings as LeRobot datasets, and train policies from them.",
}

FROM_SIMULATE = ("record", "tasks", "render", "sheets", "serve", "learn")

COMMANDS = tuple(name for name in HELP if name not in FROM_SIMULATE)
"""``safestage NAME`` is ``command`` in NAME_command.py, imported when it is called."""


class LazyGroup(click.Group):
    """Knows its commands by name, and imports one only to run it."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """All names, the evaluator's first."""
        return list(HELP)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import the command."""
        if cmd_name in COMMANDS:
            module = importlib.import_module(f"safestage_eval.cli.{cmd_name}_command")
            command: click.Command = module.command
            return with_limits(command)
        return _from_simulate(cmd_name) if cmd_name in FROM_SIMULATE else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Suggest the nearest name for one that does not exist."""
        if args and not args[0].startswith("-") and args[0] not in HELP:
            hint = did_you_mean(args[0], HELP) or f"there are {', '.join(HELP)}."
            ctx.fail(f"no command {args[0]!r}: {hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list in ``--help``, without importing anything."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, HELP[name]) for name in self.list_commands(ctx)])


def with_limits(command: click.Command) -> click.Command:
    """A command, and those below it, with ``--limits``."""
    from .shared_options import limits_option

    if isinstance(command, click.Group):
        for below in command.commands.values():
            with_limits(below)
    elif not any("--limits" in parameter.opts for parameter in command.params):
        limits_option(command)
    return command


def _from_simulate(name: str) -> click.Command:
    from safestage_eval._process import simulator

    missing = simulator.why_not()
    if missing is None:
        commands: list[click.Command] = importlib.import_module("simulate.cli").COMMANDS
        return with_limits(next(command for command in commands if command.name == name))

    @click.command(name, help=HELP[name], context_settings={"ignore_unknown_options": True})
    @click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
    def refuse(arguments: tuple[str, ...]) -> None:  # noqa: ARG001
        raise click.UsageError(f"{name!r} needs the simulator: {missing}")

    return refuse


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

    run(with_limits(command))
