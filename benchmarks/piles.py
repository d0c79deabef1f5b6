"""Random piles: does a body fall when another vanishes?  ``depends_on`` against simulation.

Three steps, each kept in a file so that the next can be repeated alone:

1. ``build``: piles of many kinds are drawn, settled in MuJoCo and recorded for a second. A pile is
   one only if it stands by itself for another ``HOLD`` with nothing taken away, and does not come
   down when the ground tilts by ``TILT``: nobody ever built what stands like a needle on its tip,
   and whether it depends on anything has no answer, for the next breath fells it. Then each body in
   turn is made intangible and the rest is simulated on: with all friction times 0.9, 1 and 1.1;
   slowly, so that what falls hits less hard; with the ground leaning by ``TILT`` each way, for
   what is left has to bear what the pile had to: a log without its chock rests on a level floor,
   and rolls off on the next one; and slowly with whatever leaves its place made intangible as
   well. What becomes of a when s vanishes is one of ``Fate``; a pair that neither falls nor stands
   counts for nothing, and the report says how many these are, and why.
2. ``judge``: the recordings are read like any other and asked for ``depends_on``.
3. ``report``: precision, recall and what stayed unknown, kind by kind, and the wrong pairs.

    python benchmarks/piles.py --each 17 --seed-base 1000 --jobs 16 --keep piles
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from pile_kinds import KINDS
from pile_parts import STEP, Pile, mjcf

from safestage_eval.api import load
from safestage_eval.episode import ContactTable, Episode, Header, RobotFrames
from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import TraceWriter
from safestage_eval.relations.relations import Relations
from simulate.world.contact_reader import ContactReader
from simulate.world.describe import Description, Facts
from simulate.world.motion_reader import MotionReader

F64 = NDArray[np.float64]

SETTLE, WATCH, FALL, HOLD = 2.5, 1.0, 2.0, 5.0
"""s: to come to rest, recorded at rest, simulated after each removal, and with none."""
SLOWED = 0.9
"""Share of all velocities that is left after a step of a slow simulation: things sink at 0.4 m/s."""
FELL = (0.005, np.radians(10))
"""m, rad: what sank farther or, being no ball, tilted more, fell."""
STOOD = (0.002, np.radians(2))
"""m, rad: what neither moved farther nor tilted more stood."""


TILT, NUDGE = np.radians(0.3), 1.0
"""rad, s: every pile bears the ground leaning by so much, each way in turn, for so long."""


class Trial(NamedTuple):
    """One way to simulate on.

    Attributes:
        friction: what all friction is multiplied by.
        slow: at every step the velocities are cut.
        clean: what leaves its place is taken away as well.
        lean: rad, how much the ground leans along x and y.
    """

    friction: float
    slow: bool = False
    clean: bool = False
    lean: tuple[float, float] = (0.0, 0.0)


TRIALS = (Trial(0.9), Trial(1.0), Trial(1.1), Trial(1.0, slow=True))
CLEAN = Trial(1.0, slow=True, clean=True)
LEANING = tuple(Trial(1.0, lean=lean) for lean in ((TILT, 0), (-TILT, 0), (0, TILT), (0, -TILT)))

Fate = Literal["falls", "stands", "moves", "between", "friction", "debris"]
"""How a moves after s is removed.

``falls`` and ``stands``: in all trials. Otherwise the pair is open: ``moves``, a moves with nothing
taken away when there is a tenth more or less of friction; ``between``, in some trial it moved, but
not far enough to have fallen; ``friction``, it falls in some trials and stands in others;
``debris``, it falls in all, but not if what leaves its place before is taken away as well. Support
is a matter of statics: what stands on its own feet until a falling neighbour strikes it, drags it
along or comes to lie against it was not held up by what vanished, nor by that neighbour, and how
hard it is struck depends on chance. But it did fall; so it counts neither for nor against.
"""
DECIDED: dict[Fate, bool] = {"falls": True, "stands": False}

Fates = dict[tuple[str, str], Fate]
"""(a, s) → what becomes of a when s vanishes."""


# ---------------------------------------------------------------- simulation


def build(kind: str, seed: int) -> tuple[TraceWriter, Fates] | None:
    """Draw, settle, record and take away; None if the pile does not stand by itself."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    pile = Pile()
    KINDS[kind](rng, pile)
    model = mujoco.MjModel.from_xml_string(mjcf(pile, float(rng.uniform(0.5, 0.9))))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, int(SETTLE / STEP))
    mujoco.mj_forward(model, data)
    if _speed(data) > 0.005:
        return None
    free = [i for i in range(1, model.nbody) if model.body_dofnum[i]]
    if any(data.xpos[i][2] < -0.01 or np.abs(data.xpos[i]).max() > 1 for i in free):
        return None
    writer = _recorded(model, data, f"{kind}.{seed}")
    mujoco.mj_forward(model, data)
    if _speed(data) > 0.005:
        return None
    untouched = [_moves(model, data, None, trial, free) for trial in TRIALS]
    if not all(_stood(motion) for motion in untouched[1].values()):
        return None
    leaning = [_moves(model, data, None, trial, free) for trial in LEANING]
    if any(_fell(motion) for moves in leaning for motion in moves.values()):
        return None
    return writer, _fates(model, data, untouched, free)


def _speed(data: mujoco.MjData) -> float:
    v = data.qvel.reshape(-1, 6)
    return float(max(np.abs(v[:, :3]).max(), 0.03 * np.abs(v[:, 3:]).max()))


def _recorded(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> TraceWriter:
    facts = [
        Facts("fixture" if not model.body_dofnum[i] else "object", up_axis=None)
        for i in range(model.nbody)
    ]
    about = Description(model, facts)
    header = Header(
        episode_id=name, physics_dt=STEP, frame_dt=2 * STEP, force_source="recorded",
        bodies=about.bodies, joints=about.joints,
    )  # fmt: skip
    writer = TraceWriter(header, meshes=about.meshes, frames=256)
    for i in about.fixed:
        writer.set_fixed(about.body(i).name, data.xpos[i].copy(), data.xquat[i].copy())
    contacts = ContactReader(model, data, about.geom_index)
    motion = MotionReader(model, data, about.movable)
    for frame in range(int(WATCH / STEP / 2)):
        mujoco.mj_step(model, data)
        contacts.between()
        mujoco.mj_step(model, data)
        motion.read()
        writer.add_frame(2 * STEP * frame, motion.pose, motion.twist, contacts=contacts.frame())
    return writer


class Motion(NamedTuple):
    """How far a body got at most (m), how far it sank (m), how much it tilted (rad; a ball: 0)."""

    far: float = 0.0
    sank: float = 0.0
    tilted: float = 0.0


def _stood(motion: Motion) -> bool:
    return motion.far < STOOD[0] and motion.tilted < STOOD[1]


def _fell(motion: Motion) -> bool:
    return motion.sank > FELL[0] or motion.tilted > FELL[1]


def _fates(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    untouched: Sequence[dict[int, Motion]],
    free: Sequence[int],
) -> Fates:
    name = {i: model.body(i).name for i in range(model.nbody)}
    found: Fates = {}
    for s in (i for i in range(1, model.nbody) if name[i] != "fix_floor"):
        gone = [_moves(model, data, s, trial, free) for trial in (*TRIALS, *LEANING)]
        clean = _moves(model, data, s, CLEAN, free)
        for a in free:
            if a != s:
                found[name[a], name[s]] = _fate(
                    [stays[a] for stays in untouched], [moves[a] for moves in gone], clean[a]
                )
    return found


def _fate(untouched: Sequence[Motion], gone: Sequence[Motion], clean: Motion) -> Fate:
    if not all(_stood(motion) for motion in untouched):
        return "moves"
    if all(_fell(motion) for motion in gone):
        return "falls" if _fell(clean) else "debris"
    if all(_stood(motion) for motion in gone):
        return "stands"
    return "friction" if all(_fell(m) or _stood(m) for m in gone) else "between"


def _moves(
    model: mujoco.MjModel,
    start: mujoco.MjData,
    removed: int | None,
    trial: Trial,
    free: Sequence[int],
) -> dict[int, Motion]:
    """Simulated on: body → its motion, in a ``clean`` trial until it is taken away itself."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start.qpos, 0
    data.qacc_warmstart[:] = start.qacc_warmstart
    friction, touches = model.geom_friction.copy(), model.geom_contype.copy()
    model.geom_friction[:, 0] *= trial.friction
    model.opt.gravity[:2] = 9.81 * np.sin(trial.lean)

    def remove(body: int) -> None:
        own = model.geom_bodyid == body
        model.geom_contype[own] = model.geom_conaffinity[own] = 0

    if removed is not None:
        remove(removed)
    duration = (1.5 if trial.slow else 1) * FALL
    if removed is None:
        duration = NUDGE if any(trial.lean) else HOLD
    every = 4 if trial.clean else 20
    most = dict.fromkeys(free, Motion())
    left = {i for i in free if i != removed}
    ball = {i: model.geom_type[model.body_geomadr[i]] == mujoco.mjtGeom.mjGEOM_SPHERE for i in free}
    place, turn = start.xipos.copy(), start.xmat.reshape(-1, 3, 3).copy()
    for step in range(1, int(duration / STEP) + 1):
        mujoco.mj_step(model, data)
        if trial.slow:
            data.qvel *= SLOWED
        if step % every:
            continue
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for i in free:
            went = data.xipos[i] - place[i]
            spun = data.xmat[i].reshape(3, 3) @ turn[i].T  # away from the vertical only
            tilt = 0.0 if ball[i] else float(np.arccos(np.clip(spun[2, 2], -1, 1)))
            far, sank, tilted = most[i]
            most[i] = Motion(
                max(far, float(np.linalg.norm(went))), max(sank, float(-went[2])), max(tilted, tilt)
            )
            if trial.clean and i in left and not _stood(most[i]):
                left.remove(i)
                remove(i)
    model.geom_friction[:] = friction
    model.opt.gravity[:2] = 0.0
    model.geom_contype[:] = model.geom_conaffinity[:] = touches
    return most


# ---------------------------------------------------------------- judgement


Answer = dict[tuple[str, str], "NDArray[np.int8]"]


def blinded(episode: Episode) -> Episode:
    """Remove contacts and forces."""
    header = episode.header.model_copy(update={"force_source": "none"})
    frames = RobotFrames.empty(len(episode))
    return Episode(header, episode.t, episode.tracks, ContactTable.empty(), frames, episode.meshes)


def answers(episode: Episode, pairs: Sequence[tuple[str, str]]) -> Answer:
    """(a, s) → (T,) 1 depends, 0 does not, −1 unknown."""
    relations = Relations(Signals(episode))
    found = {}
    for pair in pairs:
        told = relations.told("depends_on", pair)
        found[pair] = np.where(told.lower < told.upper, -1, told.lower).astype(np.int8)
    return found


@dataclass
class Tally:
    """Counts of one kind of pile."""

    piles: int = 0
    open: Counter[str] = field(default_factory=Counter)
    said: Counter[tuple[bool, int]] = field(default_factory=Counter)
    """(it falls, the answer: 1 depends, 0 does not, −1 unknown) → pairs."""

    def add(self, fate: Fate, answer: int) -> None:
        """One pair."""
        if fate in DECIDED:
            self.said[DECIDED[fate], answer] += 1
        else:
            self.open[fate] += 1

    def __add__(self, other: Tally) -> Tally:
        """Both together."""
        return Tally(self.piles + other.piles, self.open + other.open, self.said + other.said)

    @property
    def wrong_no(self) -> str:
        """Share of the certain "no" that are wrong."""
        return _share(self.said[True, 0], self.said[True, 0] + self.said[False, 0], "{:.2%}")

    def row(self, name: str) -> str:
        """One line of the table."""
        said = self.said
        hits, false, missed = said[True, 1], said[False, 1], said[True, 0]
        counts = [
            self.piles, hits + missed + said[True, -1], false + said[False, 0] + said[False, -1],
            self.open.total(), _share(hits, hits + false), _share(hits, hits + missed),
            _share(hits, hits + missed + said[True, -1]), false, missed,
            said[False, -1], said[True, -1], self.wrong_no,
        ]  # fmt: skip
        return " | ".join([f"| {name:13}", *(f"{value:>6}" for value in counts)]) + " |"


HEAD = """\
| kind          |  piles |  falls | stands |   open |      P |      R |  R all |  false | missed |  stands unknown | falls unknown | wrong "no" |
|---|---|---|---|---|---|---|---|---|---|---|---|---|"""


def _share(some: int, of: int, form: str = "{:.3f}") -> str:
    return form.format(some / of) if of else "–"


# ---------------------------------------------------------------- campaign


Rows = list[tuple[str, str, Fate]]


def record(folder: Path, kinds: Sequence[str], each: int, base: int, jobs: int) -> None:
    """Record ``each`` piles of every kind, trying the seeds from ``base`` upward.

    A kind that is there already is left as it is.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, Rows]] = {
        kind: {} for kind in kinds if not (folder / f"{kind}.json").exists()
    }
    tried = dict.fromkeys(found, 0)
    while todo := [
        (kind, base + tried[kind] + k)
        for kind, piles in found.items()
        for k in range(min(each - len(piles), 8 * each - tried[kind]))
    ]:
        for (kind, seed), rows in zip(
            todo, _each(partial(_build, folder), todo, jobs), strict=True
        ):
            tried[kind] += 1
            if rows is not None:
                found[kind][f"{kind}.{seed}"] = rows
    for kind, piles in found.items():
        (folder / f"{kind}.json").write_text(json.dumps(piles), "utf-8")


def _build(folder: Path, which: tuple[str, int]) -> Rows | None:
    built = build(*which)
    if built is None:
        return None
    writer, fates = built
    writer.close(folder / "{}.{}.mcap".format(*which))
    return [(a, s, fate) for (a, s), fate in fates.items()]


class Judged(NamedTuple):
    """Last answer per pair of one pile, and the number of answers that changed; None if a body moved."""

    answers: list[int]
    changed: int | None


def _judge(folder: Path, blind: bool, pile: tuple[str, Rows]) -> Judged:
    name, rows = pile
    episode = load(folder / f"{name}.mcap")
    said = answers(blinded(episode) if blind else episode, [(a, s) for a, s, _ in rows])
    still = all(
        np.abs(track.position - track.position[0]).max() < 1e-3
        and np.abs(track.orientation - track.orientation[0]).max() < 0.008
        for track in episode.tracks.values()
    )
    changed = sum(bool((answer != answer[0]).any()) for answer in said.values())
    return Judged([int(said[a, s][-1]) for a, s, _ in rows], changed if still else None)


def report(folder: Path, kinds: Sequence[str], *, blind: bool, jobs: int) -> None:
    """Print the table, the wrong pairs, and how many answers changed while nothing moved."""
    piles = {
        kind: list(json.loads((folder / f"{kind}.json").read_text("utf-8")).items())
        for kind in kinds
    }
    flat = [pile for kind in kinds for pile in piles[kind]]
    judged = iter(_each(partial(_judge, folder, blind), flat, jobs))
    total, wrong, asked, changed = Tally(), list[str](), 0, 0
    print(HEAD)
    for kind in kinds:
        tally = Tally()
        for name, rows in piles[kind]:
            one = next(judged)
            tally.piles += 1
            if one.changed is not None:
                asked, changed = asked + len(rows), changed + one.changed
            for (a, s, fate), answer in zip(rows, one.answers, strict=True):
                tally.add(fate, answer)
                if fate in DECIDED and answer != DECIDED[fate]:
                    said = "unknown" if answer < 0 else "wrong"
                    wrong.append(f"{said}: {name}: {a} {fate} without {s}")
        print(tally.row(kind), flush=True)
        total += tally
    print(total.row("all"))
    print("open:", ", ".join(f"{count} {why}" for why, count in total.open.most_common()))
    print(f"{changed} of {asked} pairs changed within {WATCH:g} s in which no body moved by 1 mm")
    print(*wrong, sep="\n")


def _each(function: Callable[[Any], Any], items: Sequence[Any], jobs: int) -> Iterator[Any]:
    """The results in order, by several processes."""
    if jobs == 1:
        yield from map(function, items)
        return
    with get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap(function, items)


def main() -> None:
    """See the head of the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--each", type=int, default=17, help="piles of each kind")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--seed-base", type=int, default=0, help="the first seed of each kind")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--keep", type=Path, default=Path("piles"), help="folder of recordings")
    parser.add_argument("--blind", action="store_true", help="judge without contacts and forces")
    given = parser.parse_args()
    record(given.keep, given.kinds, given.each, given.seed_base, given.jobs)
    report(given.keep, given.kinds, blind=given.blind, jobs=given.jobs)


if __name__ == "__main__":
    main()
