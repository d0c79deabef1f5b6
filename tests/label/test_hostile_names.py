"""Names that try to be markup or script, on the labelling page in a real browser: they stay text."""

import numpy as np
from scenes import Scene
from sitting import RULES, served
from test_label_page import answers, at, come

from safestage_eval.episode import Geom
from safestage_eval.formats import discover, save
from safestage_eval.label import Ledger, Session, sample
from safestage_eval.rules import load_rules

TRIED = "document.title='broken in'"
TAG = f'<img src=x onerror="{TRIED}">'
END = f"</script><script>{TRIED}</script>"
QUOTES = f"\"'><svg onload={TRIED}>"
TURNED = "\u202ecup"


def hostile(folder):
    """Two rollouts of which everything that has a name has such a one."""
    path = np.linspace([0.3, 0, 0.05], [0.5, 0, 0.05], 60)
    for i in range(2):
        scene = Scene(60, 60).fixed("table").box(TAG, 0.04, path)
        scene.body(END, Geom(kind="cylinder", size=(0.04, 0.1)), (0.8, 0, 0.1))
        scene.body(TURNED, Geom(kind="sphere", size=(0.03,)), (0.8, 0.4, 0.03))
        episode = scene.episode(
            episode_id=f"{QUOTES}/{i}", task=TAG, policy=END, stage="ETS", prompt=QUOTES, seed=0,
            rollout=i, instruction=f"{TAG} {END} {QUOTES} {i}", notes=(TAG,), success=True,
            success_time=0.5, roles={"target": (TAG,), "protected": (END, TURNED)}, rules=("ETS901",),
        )  # fmt: skip
        save(episode, folder / f"{i}.mcap")
    rules = RULES.replace("Keep the cup off the vase", TAG.replace('"', "'"))
    (folder / "rules.toml").write_text(rules.replace("A vase breaks.", END))
    return Session(
        sample(discover(folder)),
        load_rules([folder / "rules.toml"]),
        Ledger(folder / "labels.csv"),
        commands=(f"safestage {TAG}",),
    )


def test_hostile_names_stay_text(tab, tmp_path):
    asked, said = [], []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("console", lambda message: said.append(message.text))
    with served(hostile(tmp_path)) as server:
        come(tab, server, QUOTES)
        at(tab, 0)
        title = tab.title()
        assert tab.locator("#task").inner_text() == f"{TAG} {END} {QUOTES} 0"
        shown = tab.locator("#requirement").inner_text()
        assert TAG in shown
        assert END in shown
        tab.keyboard.press("n")
        tab.keyboard.type(TAG)
        tab.keyboard.press("Escape")
        tab.keyboard.press("u")
        at(tab, 1)
        tab.keyboard.press("s")
        tab.get_by_role("heading", name="All answered").wait_for()
        assert TAG in tab.locator("#commands").inner_text()
        assert [answer[1:] for answer in answers(server)] == [
            ("unsafe", QUOTES, TAG),
            ("safe", QUOTES, ""),
        ]
        tab.reload()
        tab.get_by_role("heading", name="All answered").wait_for()
        assert tab.title() == title
        assert tab.locator("img[src=x], svg[onload], [onerror]").count() == 0
        assert tab.locator("script").count() == tab.evaluate(
            "[...document.scripts].filter(s => !s.textContent.includes('broken in')).length"
        )
        assert asked
        assert all(url.startswith(server.url.rsplit("/", 1)[0]) for url in asked)
        assert not [words for words in said if "WebGL" not in words]
