"""Draws an example that violates and one that passes for every built-in rule: docs/images/rules/CODE.svg.

    python docs/rule_pictures.py               all
    python docs/rule_pictures.py ISH101 FSH103 these rules

The moment is the one that decided the verdict, or one near it; dashed is where things were at the start.
Needs the plot extra (matplotlib).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from drawing import View, draw_scene, frame_of_interest, outlines
from figures import STYLE

from safestage_eval.episode import Episode
from safestage_eval.palette import INKS
from safestage_eval.report.catalogue import FILES
from safestage_eval.rules import RuleSet, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts.verdict import Verdict
from safestage_eval.whatif.examples import Library

OUT = Path(__file__).parent / "images" / "rules"

PAIRS: dict[str, tuple[str, str]] = {
    "ISH101": ("can_from_under_bottle", "bottle_taken_off_first"),
    "ISH102": ("pier_shifted(way = 6)", "board_taken_down_first"),
    "ISH103": ("lean_gives_way", "book_laid_down_first"),
    "ISH104": ("glass_slides_off_tray", "tray_cleared_first"),
    "ISH105": ("bottle_set_down_topples(angle = 90)", "bottle_taken_off_first"),
    "ISH201": ("lemon_tipped_out", "lemon_taken_out_first"),
    "ISH202": ("lemon_tipped_out", "bin_handled_with_lemon(height = 8, angle = 10)"),
    "ISH203": ("lemon_tipped_out", "lemon_taken_out_first"),
    "ETS101": ("obstacle_touched", "carried_past(gap = 12)"),
    "ETS102": ("obstacle_disturbed(way = 10)", "obstacle_disturbed(way = 0.9)"),
    "ETS103": ("obstacle_disturbed(angle = 80)", "obstacle_disturbed(angle = 10)"),
    "ETS104": ("arm_beside_vase(hand_gap = 0.5)", "arm_beside_vase(hand_gap = 6)"),
    "ETS105": ("fragile_tapped(peak = 21)", "fragile_tapped(peak = 19)"),
    "ETS106": ("bystander_shoved(way = 12)", "bystander_shoved(way = 2)"),
    "ETS107": ("shoved_against", "shoved_against(way = 0)"),
    "ETS201": ("carried_past(gap = 3)", "carried_past(gap = 12)"),
    "ETS202": ("carried_over(height = 10)", "carried_over(height = 41)"),
    "ETS203": ("region_entered(deep = 4)", "region_entered(deep = -4)"),
    "ETS204": ("cup_carried_askew(angle = 40)", "cup_carried_askew(angle = 5)"),
    "ETS205": ("squeezed(grip = 31)", "squeezed(grip = 29)"),
    "FSH101": ("placed_on_shelf(margin = 0.3)", "placed_on_shelf(margin = 6)"),
    "FSH102": ("placed_on_shelf(margin = 0.3)", "placed_on_shelf(margin = 6)"),
    "FSH103": ("placed_on_post(off = 2)", "placed_on_post"),
    "FSH104": ("rolled_after_release(way = 12)", "rolled_after_release(way = 1)"),
    "FSH105": ("let_go_above(height = 15)", "let_go_above(height = 1)"),
    "FSH106": ("creeping_after_success(way = 20)", "creeping_after_success(way = 1)"),
    "FSH201": ("left_apart(gap = 0.5)", "left_apart(gap = 12)"),
    "FSH202": ("neighbour_pushed(way = 8)", "neighbour_pushed(way = 0.5)"),
    "FSH203": ("left_beside", "left_apart"),
    "FSH204": ("left_on_top", "left_on_top(x = -25, level = 0)"),
    "FSH205": ("left_beside(during = 4.3 to 4.4)", "left_apart"),
}
"""Code → a sketch of rules/examples that violates and one that passes, its knobs turned so that it shows."""

SIDE = {
    *((code, i) for code in ("ISH101", "ISH105", "ETS102", "ETS103", "ETS106", "FSH101", "FSH102") for i in (0, 1)),
    *((code, 1) for code in ("ISH104", "ISH201", "ISH203")),
}  # fmt: skip
"""(code, 0 violating or 1 passing): sketches drawn from the side; the others are drawn from the front."""

MOMENTS = {
    ("ETS107", 1): 3.0, ("FSH105", 0): 4.02,
    ("ISH104", 1): 4.5, ("ISH105", 1): 3.0, ("ISH203", 0): 1.8, ("ISH203", 1): 3.0,
}  # fmt: skip
"""s, where the deciding moment shows little."""

MOVED = 0.005
"""m. A body that went less far since the start is not outlined there."""


def draw(rules: RuleSet, rule: ast.Rule, library: Library, target: Path) -> None:
    """Both examples side by side, each at its moment."""
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    names = PAIRS[rule.code]
    judged = [(library.episode(name, rule), library.judge(name, rules, rule)) for name in names]
    if [verdict.verdict for _, verdict in judged] != ["violation", "pass"]:
        raise ValueError(f"{rule.code}: {[verdict.explanation for _, verdict in judged]}")
    with mpl.rc_context(STYLE):
        figure, panels = plt.subplots(1, 2, figsize=(6.2, 2.4), layout="constrained")
        for i, (panel, (episode, verdict)) in enumerate(zip(panels, judged, strict=True)):
            time = MOMENTS.get((rule.code, i), moment(episode, verdict))
            frame = int(np.abs(episode.t - time).argmin())
            scene(panel, episode, frame, "yz" if (rule.code, i) in SIDE else "xz")
            word = {"violation": "violated", "pass": "passed"}[verdict.verdict]
            panel.set_title(f"{word}, at {episode.t[frame]:.1f} s", fontsize=8)
        figure.savefig(target, metadata={"Date": None})
        plt.close(figure)


def moment(episode: Episode, verdict: Verdict) -> float:
    """The time (s) of the verdict's witness, else of success, else of the end."""
    times = (verdict.worst_time, verdict.time, episode.header.success_time, float(episode.t[-1]))
    return next(time for time in times if time is not None)


def scene(panel: Any, episode: Episode, frame: int, view: View) -> None:
    """The bodies at a frame, and dashed where they were at the start."""
    from matplotlib.patches import Polygon

    kinds = ("robot", "gripper") if view == "xy" else ()
    bodies = [b.name for b in episode.header.bodies if b.geoms and b.kind not in kinds]
    window = frame_of_interest(episode, [0, frame], [], view)
    draw_scene(panel, episode, frame, bodies, view, window)
    for body in episode.header.bodies:
        place = episode.track(body.name).position if body.geoms else None
        if body.kind != "object" or place is None:
            continue
        if np.linalg.norm(place[frame] - place[0]) < MOVED:
            continue
        for _, flat in outlines(episode, body.name, 0, view):
            panel.add_patch(
                Polygon(flat, fill=False, edgecolor=INKS["ink-soft"].light, linewidth=0.8, ls="--")
            )


def main() -> None:
    """Draw all rules, or the named ones."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("codes", nargs="*", metavar="CODE")
    args = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    rules, library = load_rules(list(FILES)), Library()
    for code, rule in rules.rules.items():
        if not args.codes or code in args.codes:
            draw(rules, rule, library, OUT / f"{code}.svg")
            print(f"docs/images/rules/{code}.svg")


if __name__ == "__main__":
    main()
