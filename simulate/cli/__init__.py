"""The commands that need MuJoCo: a file for each."""

from __future__ import annotations

import click

from .gallery import gallery
from .record import record
from .render import render
from .serve import serve
from .sheets import sheets
from .tasks import tasks
from .validate import validate

tasks.add_command(validate)
tasks.add_command(gallery)

COMMANDS: list[click.Command] = [record, tasks, render, sheets, serve]
