"""Remarks on what recordings without contacts and models lack, in the same words for all formats."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from safestage_eval.episode import Body
from safestage_eval.errors import nearest

from .account import Account
from .map_tables import MapFile


def say_contacts(account: Account) -> None:
    """Remark that no contact was recorded."""
    account.missing(
        "contacts and their forces",
        "contact and support are inferred from geometry",
        cost="contact_force, peak_force, impulse and all rules on forces: inconclusive",
        remedy="none: they were not recorded",
    )


def say_links(account: Account, robot: str) -> None:
    """Remark that only root and joints of an articulation are recorded."""
    account.missing(
        f"poses of the links of {robot}",
        "only its root and its joints are recorded",
        cost="distances and contacts of the arm, reach, forbidden rooms: inconclusive",
        remedy="--robot FILE, its URDF or MJCF, places them by its joints",
    )
    account.guessed(
        f"names and kinds of the joints of {robot}",
        "numbered, revolute",
        cost="rules that name a joint",
    )


def unused_entries(names: Collection[str], map_: MapFile) -> list[str]:
    """Body entries of the map file that name no body of any episode, each as a message; not patterns."""
    said = []
    for entry in dict.fromkeys(map_.body_names):
        if entry not in names and not set(entry) & set("*?["):
            near = nearest(entry, names)
            meant = (
                f"did you mean [body.{near}]?"
                if near
                else f"one of {', '.join(sorted(names)[:12])}"
            )
            said.append(f"{map_.path}: [body.{entry}] names no body of the source; {meant}")
    return said


def say_bodies(account: Account, bodies: Sequence[Body], map_: MapFile, com: str) -> None:
    """Remark on unknown properties of objects; ``com``: where their centres of mass are assumed."""
    objects = [body for body in bodies if body.kind == "object"]
    bare = [body.name for body in bodies if body.kind in ("object", "fixture") and body.unseen]
    if bare:
        account.missing(
            f"shapes of {', '.join(bare)}",
            cost="their contacts, clearances and supports: inconclusive",
            remedy="[body.NAME] shapes in the map file",
        )
    if any(body.mass is None for body in objects):
        account.missing(
            "masses", cost="impact, damage, and what needs a weight: inconclusive",
            remedy="[body.NAME] mass in the map file",
        )  # fmt: skip
    if any("up_axis" in body.untold for body in objects):
        account.missing(
            "up axes", cost="tilt, and with it toppled and upright: inconclusive",
            remedy="[body.NAME] up in the map file; false for what has none",
        )  # fmt: skip
    if any("cavity" in body.untold for body in bodies):
        account.missing(
            "insides of containers", cost="inside and containment_depth: inconclusive",
            remedy="[body.NAME] cavity in the map file; false for what has none",
        )  # fmt: skip
    mapped = {b.name for b in objects if (t := map_.of_body(b.name)) and t.com is not None}
    if any(body.name not in mapped for body in objects):
        account.guessed(
            "centres of mass",
            com,
            cost="displacement and height of what turns are those of this point",
            remedy="[body.NAME] com in the map file",
        )


def say_success(account: Account, *, known: bool, hold: float | None, how: str = "") -> None:
    """Remark on whether success is recorded, and for how long (s) after it; ``how``: what happened then."""
    if not known:
        account.missing(
            "success", cost="rates of success, and what depends on its moment",
            remedy="[episode.NAME] success and success_time in the map file",
        )  # fmt: skip
    if hold is not None and hold <= 0:
        say_last_row(account)
    if hold is not None and hold < 5:
        account.missing(
            "the time after success", f"{hold:.2f} s of it: {how}",
            cost="rules on the final state (FSH): inconclusive",
            remedy="record on for 5 s after success with the robot frozen",
        )  # fmt: skip


def say_last_row(account: Account) -> None:
    """Remark that the moment of success is the last row, which is where many recorders end in any case."""
    account.guessed(
        "the moment of success", "the last row: recording ends with it",
        cost="what is judged up to success or after it",
        remedy="--bind with a goal, or [episode.NAME] success_time in the map file",
    )  # fmt: skip
