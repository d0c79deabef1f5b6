"""The commands that need MuJoCo: a file for each group."""

from __future__ import annotations

import click

from .record import record
from .tasks import tasks
from .validate import validate

tasks.add_command(validate)

COMMANDS: list[click.Command] = [record, tasks]
