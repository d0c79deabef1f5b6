"""A campaign: policies, prompts, tasks, seeds and rollouts to be recorded, in one file."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from safestage_eval._text.toml_text import from_toml
from safestage_eval.errors import InputError
from simulate.catalogue.objects import Strict
from simulate.tasks.task import Task, tasks_matching

from .jobs import Format, Job, plan


class Campaign(Strict):
    """A campaign: every combination is recorded."""

    policies: tuple[str, ...] = Field(min_length=1)
    """Names of policies, in the form of ``--policy``."""
    prompts: tuple[Literal["default", "generic", "specific"], ...] = Field(
        ("default",), min_length=1
    )
    tasks: tuple[str, ...] = ("*",)
    """Ids, files or patterns."""
    stages: tuple[Literal["ISH", "ETS", "FSH"], ...] = ("ISH", "ETS", "FSH")
    """Only tasks of these."""
    families: tuple[str, ...] = ("*",)
    """Only tasks of these; patterns."""
    seeds: tuple[int, ...] = Field((0, 1, 2), min_length=1)
    rollouts: int = Field(1, ge=1)
    horizon: float | None = Field(None, gt=0)
    """s, instead of the tasks' own."""
    out: str | None = None
    """Folder, from where the command runs."""
    format: Format | None = None
    servers: dict[str, str] = Field(default_factory=dict)
    """Name → address: ``{name}`` in a policy stands for it."""

    def chosen(self) -> list[Task]:
        """Its tasks. Raises InputError when none is left."""
        result = [
            task
            for task in tasks_matching(self.tasks)
            if task.stage in self.stages
            and any(fnmatchcase(task.family, pattern) for pattern in self.families)
        ]
        if not result:
            raise InputError("campaign", "no task is of these stages and families.")
        return result

    def named(self, servers: Mapping[str, str] | None = None) -> tuple[str, ...]:
        """The policies with the addresses of their servers; those given go before the file's.

        Raises InputError for a server that is not in the file, given or asked for.
        """
        servers_by_name = {**self.servers, **(servers or {})}
        stray = sorted(set(servers or {}) - set(self.servers))
        if stray:
            raise InputError(
                f"server {stray[0]!r}", "the campaign has no server of that name.",
                ", ".join(self.servers) or "it has none",
            )  # fmt: skip

        def address(match: re.Match[str]) -> str:
            if match[1] not in servers_by_name:
                raise InputError(
                    f"policy {match.string!r}", f"no address of the server {match[1]!r}.",
                    ", ".join(servers_by_name) or "none are named", "name it under [servers]",
                )  # fmt: skip
            return servers_by_name[match[1]]

        return tuple(re.sub(r"\{(\w+)\}", address, policy) for policy in self.policies)

    def jobs(
        self, robot_mjcf: Path | None = None, servers: Mapping[str, str] | None = None
    ) -> list[Job]:
        """Every rollout, tasks outermost. ``servers``: see ``named``."""
        return plan(
            self.chosen(),
            self.named(servers),
            self.seeds,
            self.prompts,
            self.rollouts,
            horizon=self.horizon,
            robot_mjcf=robot_mjcf,
        )


def read_campaign(path: Path) -> Campaign:
    """A campaign file. Raises InputError with every mistake in it."""
    try:
        return Campaign.model_validate(from_toml(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise InputError(str(path), "no such campaign file") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(str(path), f"not valid TOML: {error}") from None
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise InputError(
            str(path), wrong, ", ".join(Campaign.model_fields), "see docs/tasks.md"
        ) from None
