"""The commands that need MuJoCo: a file for each."""

from __future__ import annotations

import click

from .learn_command import learn
from .record_command import record
from .render_command import render
from .serve_command import serve
from .sheets_command import sheets
from .tasks_command import tasks
from .tasks_gallery_command import gallery
from .tasks_validate_command import validate

tasks.add_command(validate)
tasks.add_command(gallery)

COMMANDS: list[click.Command] = [record, tasks, render, sheets, serve, learn]
