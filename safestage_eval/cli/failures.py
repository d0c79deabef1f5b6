"""Failures of commands: one message on stderr, and exit code 2."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import re
import sys
from io import TextIOWrapper

import click

from safestage_eval._text.line_width import LINE_WIDTH
from safestage_eval._text.printable import printable_lines
from safestage_eval.errors import InputError, RuleError, nearest, shortened

from .terminal import line_width, say, say_lines

LONGEST = 4000
"""Characters of a message about wrong usage, which may list episodes."""

GARBAGE = 10_000
"""Objects between two looks for garbage. Most that are made are modules and functions, which stay; at
Python's 700, looking took a twentieth of a short run."""

_DISK = {errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EPERM, errno.EFBIG, errno.EDQUOT}
"""Full disks, and folders that may not be written to."""

_FAILING = {errno.EIO, errno.ENXIO, errno.ENODEV, errno.ESTALE, errno.ETIMEDOUT}
"""Errors of failing disks and network file systems."""


def run(command: click.Command) -> None:
    """Run a command and exit with its code; an ``InputError`` becomes a message and 2."""
    gc.set_threshold(GARBAGE)
    # pydantic would look through all installed packages for plugins
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    atexit.register(gc.freeze)  # looking for garbage as the process ends took a seventh of it
    stdout = sys.stdout
    if isinstance(stdout, TextIOWrapper) and stdout.errors == "strict":
        stdout.reconfigure(errors="backslashreplace")  # names of files need not be text
    LINE_WIDTH.set(line_width())
    try:
        code = command.main(standalone_mode=False)
    except click.ClickException as error:
        if instead := replacement(error):
            say(f"error: {instead}", err=True)
            sys.exit(2)
        message = error.message + near_choice(error)
        error.message = printable_lines(shortened(message, LONGEST))  # type: ignore[misc]
        error.show()
        sys.exit(2)
    except click.Abort:
        say("interrupted", err=True)
        sys.exit(130)
    except InputError as error:
        text = str(error)
        if isinstance(error, RuleError):
            say_lines(text if text.startswith("error[") else f"error: {text}", err=True)
        else:
            say(f"error: {text}", err=True)
        sys.exit(2)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        if error.errno not in _DISK | _FAILING:
            raise
        where = f"{error.filename}: " if error.filename else ""
        what = "the disk fails" if error.errno in _FAILING else "cannot be written"
        say(f"error: {where}{what}: {error.strerror}.", err=True)
        sys.exit(2)
    except SystemExit:
        if sys.stdout is not stdout:  # click muffles it when the reader of a pipe has gone:
            sys.exit(0)  # no failure
        raise
    sys.exit(code if isinstance(code, int) else 0)


GONE = {
    "verify": "score TRACES --golden FILE judges again and lists what differs",
    "score --cache": "finished rows are reused: --resume DIR",
    "score --clearance-backend": "distances are always our own, with certified bounds",
    "score --no-cache": "nothing is kept between runs without --resume DIR",
    "score --manifest": "rows have rule_digest, trace_hash and version; sign the --output FILE",
    "compare --resamples": "2000 always; --random-seed draws others",
    "tables --resamples": "2000 always; --random-seed draws others",
    "test --kind": "--mutate makes mutants of every kind",
    "diff --json": "compare verdicts --format json says which verdicts flip, and why",
    "verdicts --format csv": "--format json",
    "verdicts --format markdown": "--format table",
    "agreement --format markdown": "--format table",
    "rules lsp": "name schemas/rules.schema.json to the TOML plugin of your editor (docs/rules.md)",
}
"""Commands, options and formats that there were once → what to use in their place."""


def replacement(error: click.ClickException) -> str:
    """What to use in place of a command or option of ``GONE``; empty for other failures."""
    context = error.ctx if isinstance(error, click.UsageError) else None
    if context is None:
        return ""
    if isinstance(error, click.NoSuchOption):
        name = error.option_name
    elif given := re.match(r"'([^']*)' is not one of", error.message):
        name = f"--format {given[1]}"
    else:
        named = re.match(r"no (?:such )?command '([^']*)'", error.message, re.IGNORECASE)
        name = named[1] if named else ""
    group = context.command.name or ""
    instead = GONE.get(f"{group} {name}" if context.parent or name.startswith("-") else name)
    return f"{context.command_path} {name} is gone: {instead}" if instead else ""


def near_choice(error: click.ClickException) -> str:
    """The choice of an option that a misspelt one is nearest to; empty for other failures."""
    param = error.param if isinstance(error, click.BadParameter) else None
    if param is None or not isinstance(param.type, click.Choice):
        return ""
    given = re.match(r"'([^']*)' is not one of", error.message)
    near = nearest(given[1], map(str, param.type.choices)) if given else ""
    return f" Did you mean {near!r}?" if near else ""
