"""Remarks on what is missing, recomputed or guessed where only states were stored."""

from __future__ import annotations

from safestage_eval.episode import Body
from safestage_eval.importers import Account, MapFile
from simulate.world.describe import body_name

from .foreign_facts import ForeignFacts
from .model_file import FIX, Loaded

MAP = "--map with"


def tell(
    loaded: Loaded, facts: ForeignFacts, bodies: tuple[Body, ...], map_: MapFile, account: Account
) -> None:
    """Say it of one episode; what a map file gives is not missing."""
    account.missing("joint torques", cost="rules on them are inconclusive")
    if facts.hand is None:
        account.missing(
            "finger sides",
            cost="whether something is held is not known from forces",
            remedy=f'{MAP} [body.NAME] finger = "left"',
        )
    if any("up_axis" in body.untold for body in bodies):
        account.missing(
            "up axes",
            cost="tilt, and with it toppled and upright: inconclusive",
            remedy=f'{MAP} [body."*"] up = [0, 0, 1], or one by one; false for what has none',
        )
    if any("cavity" in body.untold for body in bodies):
        account.missing(
            "insides of containers",
            cost="inside and containment_depth: inconclusive",
            remedy=f"{MAP} [body.NAME] cavity, or false for what has none",
        )
    if not all(_says(map_, body.name, "material") for body in bodies if body.kind == "object"):
        account.missing(
            "materials and tags",
            cost="limits by material are those of the default row, and nothing is fragile",
            remedy=f"{MAP} [body.NAME] material, tags",
        )
    lost = {*map(body_name, loaded.shapeless)}
    if loaded.lost:
        files = f"{len(loaded.lost)} file{'s' * (len(loaded.lost) > 1)}"
        account.missing(
            f"shapes of {len(lost)} {'bodies' if len(lost) > 1 else 'body'} ({', '.join(sorted(lost)[:4])}"
            f"{', …' * (len(lost) > 4)})",
            f"{files} of the model not found in {loaded.looked}: {', '.join(loaded.lost[:2])}"
            f"{', …' * (len(loaded.lost) > 2)}",
            cost="their contacts, clearances and supports, and all contact forces: inconclusive",
            remedy=FIX,
        )
    unseen = [body.name for body in bodies if body.unseen and body.name not in lost]
    if unseen:
        account.missing(
            f"shapes of {', '.join(unseen)}",
            "drawn, but nothing can touch them in the source",
            cost="clearances of the robot are inconclusive",
            remedy=f"{MAP} [body.NAME] shapes",
        )
    unweighed = [name for name in map(body_name, loaded.unweighed) if not _says(map_, name, "mass")]
    if unweighed:
        account.missing(
            f"masses of {', '.join(unweighed)}",
            "the file has them from visual meshes, by an amount that depends on the version of "
            "MuJoCo; forces are computed with the mass of the collision shapes",
            cost="forces on these bodies are wrong, and rules that need their weight inconclusive",
            remedy=f"{MAP} [body.NAME] mass",
        )


def tell_forces(version: str, account: Account, *, known: bool, commanded: bool) -> None:
    """Say where contacts and forces come from.

    Args:
        version: of the MuJoCo that computed them.
        account: receives it.
        known: it is the one that recorded the states, and there are enough of them.
        commanded: the actuators' commands were stored.
    """
    account.recomputed(
        "contacts and contact forces",
        f"by a forward pass of MuJoCo {version} over each stored state",
        cost="force peaks between rows are not seen",
    )
    if known and not commanded:
        account.recomputed(
            "forces on and by the robot",
            "by how the robot moves from row to row, for its command is not stored",
            cost="unknown where the rows before and after give different forces: where it strikes, slips or "
            "presses hard on what stands fixed",
        )
    elif not known:
        account.missing(
            "forces on and by the robot, and of what it presses on",
            "the file does not say which MuJoCo recorded it, and versions differ by newtons",
            cost="limits on these forces, and grasps told by them, are inconclusive",
            remedy="--python PATH, a Python that has the recorder's mujoco",
        )


def _says(map_: MapFile, body: str, field: str) -> bool:
    said = map_.of_body(body)
    return said is not None and field in said.model_fields_set
