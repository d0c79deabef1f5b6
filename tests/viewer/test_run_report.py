"""Reports as text: complete in themselves, well formed, and saying what the results say."""

import json
import random
import re
import zlib
from base64 import b64decode
from html.parser import HTMLParser

import pytest

from safestage_eval.errors import InputError
from safestage_eval.metrics import aggregate
from safestage_eval.metrics.outcome import Outcome
from safestage_eval.viewer.campaign.campaign_data import compose
from safestage_eval.viewer.campaign.episode_pieces import Pieces
from safestage_eval.viewer.campaign.overview import Report
from safestage_eval.viewer.packed import packed
from safestage_eval.viewer.run_report import prepared, report_page, write_folder

VOID = {"meta", "link", "input", "br", "img"}
EVIL = "<script>alert(\"1\")</script> & 'quotes'"


def outcomes(tasks=6, policies=("alpha", "beta"), prompts=("default", "specific"), rollouts=2):
    """Outcomes of a made-up campaign, every cell alike in number."""
    dice = random.Random(3)
    stages = ("ISH", "ETS", "FSH")
    return [
        Outcome(policy, prompt, stages[t % 3], dice.random() < 0.6, dice.random() < 0.4, True,
                task=f"task_{t}", family=None, seed=seed, rollout=rollout)
        for t in range(tasks) for policy in policies for prompt in prompts
        for seed in range(3) for rollout in range(rollouts)
    ]  # fmt: skip


def row(i, **more):
    """A result row with a finding."""
    return {
        "episode_id": f"e{i}", "task": f"task_{i % 97}", "stage": ("ISH", "ETS", "FSH")[i % 3],
        "policy": f"policy {i % 4}", "prompt": ("default", "generic", "specific")[i // 4 % 3],
        "seed": i // 1200 % 3, "rollout": i // 12, "success": i % 5 != 0, "rule": f"ETS10{i % 7}", "assigned": True,
        "verdict": ("violation", "pass", "pass")[i % 3], "time": 0.01 * (i % 997), "worst_time": 0.01 * (i % 997) + 0.5,
        "phase": "execution", "signal": f"clearance(body_{i % 50}, glass)", "value": 0.13 * (i % 61), "limit": 8.0,
        "unit": "cm", "margin": 0.13 * (i % 61) - 8, "margin_normalised": 0.016 * (i % 61) - 1, "severity": None,
        "consequence_of": None, "intervals": [[1.0, 1.0 + 0.01 * (i % 99)]], "version": "0.1.0", "rule_digest": "d" * 64,
        "explanation": f"body_{i % 50} came too close to glass at {0.01 * (i % 997):.2f} s: it was {0.13 * (i % 61):.1f} cm.",
        "trace_hash": "", **more,
    }  # fmt: skip


def made_of(rows, **more):
    from safestage_eval.metrics import outcomes_of

    return Report("A report", "rows.parquet", aggregate(outcomes_of(rows)), rows, **more)


class Reader(HTMLParser):
    """Checks that elements nest, and collects what tests ask about."""

    def __init__(self, text):
        super().__init__()
        self.open, self.seen, self.titled = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.seen.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "title" and "svg" in self.open:
            self.titled.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.seen.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, (tag, self.open[-3:])
        self.open.pop()

    def all(self, tag):
        return [attributes for name, attributes in self.seen if name == tag]


@pytest.fixture(scope="module")
def bare():
    every = outcomes()
    return report_page(Report("A report", "outcomes.csv", aggregate(every), outcomes=every))


def test_it_is_well_formed_and_every_drawing_has_a_name(bare):
    read = Reader(bare)
    drawings = [a for a in read.all("svg") if "aria-hidden" not in a]
    assert len(drawings) == 2  # scatter, bars
    assert all(a["role"] == "img" and a["aria-label"] for a in drawings)
    assert all("scope" in a for a in read.all("th"))
    ids = [a["id"] for _, a in read.seen if "id" in a]
    assert len(ids) == len(set(ids))


def test_it_asks_for_nothing_from_elsewhere(bare):
    read = Reader(bare)
    links = [a[key] for _, a in read.seen for key in ("src", "href") if key in a]
    assert all(link.startswith(("#", "data:")) for link in links)
    assert not re.search(r"@import|url\((?!#)", bare.partition("</head>")[0])
    assert "default-src 'none'" in read.all("meta")[1]["content"]


def test_the_headline_says_what_the_outcomes_say():
    every = outcomes()
    text = report_page(Report("A report", "x", aggregate(every), outcomes=every))
    n, sr = len(every), sum(o.success for o in every)
    unsafe = sum(o.success and o.violation for o in every)
    assert f"{unsafe} of {sr} successes were unsafe" in text
    assert f"{sr} of {n} reached the goal" in text
    assert f"{100 * sr / n:.1f} %" in text


def test_what_is_undecided_makes_an_interval_of_every_rate():
    """20 rollouts, 4 of them violate, 16 undecided: nothing says VR 100 %."""
    every = [
        Outcome("p", "default", "ETS", True, True if i < 4 else None, True, task="t", family=None,
                seed=i, rollout=0)
        for i in range(20)
    ]  # fmt: skip
    text = report_page(Report("A report", "x", aggregate(every), outcomes=every))
    tiles = re.findall(r'<span class="big">([^<]*)</span>', text)
    assert tiles == ["100 %", "0–80 %", "20–100 %", "20–100 %"]  # SR, SSR, USR, VR
    assert text.count("20–100</a>") == 2  # the task's cells of the heat map
    assert 'class="open s1"' in text  # the band about the mark


def test_what_results_call_things_cannot_become_part_of_the_page():
    every = [
        Outcome(EVIL, EVIL, "ETS", True, True, True, task=EVIL, family=None, seed=1, rollout=1)
    ]
    text = report_page(Report(EVIL, EVIL, aggregate(every), outcomes=every, notes=[EVIL]))
    Reader(text)
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text


def test_the_same_results_give_the_same_bytes():
    every = outcomes()
    assert report_page(Report("A", "x", aggregate(every), outcomes=every)) == report_page(
        Report("A", "x", aggregate(every), outcomes=every)
    )


def data_of(text, name="run"):
    (block,) = re.findall(
        rf'<script type="application/x-deflate" id="piece-{name}">([^<]*)</script>', text
    )
    data = json.loads(zlib.decompress(b64decode(block)))
    return {
        table: {
            key: [c["values"][i] for i in c["at"]] if isinstance(c, dict) else c
            for key, c in data[table].items()
        }
        for table in ("episodes", "findings")
    }


def test_the_list_holds_the_rows_that_it_should():
    rows = [
        row(0), row(1), row(2, verdict="inconclusive", value=None, margin=float("nan")),
        row(0, rule="FSH101", assigned=False, verdict="violation", consequence_of="ETS100"),
        row(1, rule="FSH101", assigned=False, verdict="pass"),
        row(2, rule="COST1", verdict=None),
    ]  # fmt: skip
    found = data_of(report_page(made_of(rows)))
    episodes, findings = found["episodes"], found["findings"]
    assert episodes["id"] == ["e0", "e1", "e2"]
    assert episodes["verdict"] == ["violation", "pass", "inconclusive"]
    assert findings["of"] == [0, 0, 1, 2]
    assert findings["rule"] == ["ETS100", "FSH101", "ETS101", "ETS102"]
    assert findings["verdict"] == ["violation", "violation", "pass", "inconclusive"]
    assert findings["follows"] == [None, "ETS100", None, None]
    assert findings["margin"] == [-8, -8, -7.87, None]
    assert findings["intervals"] == [[[1.0, 1.0]], [[1.0, 1.0]], 0, 0]
    assert [bool(text) for text in findings["text"]] == [True, True, False, True]
    for table in (episodes, findings):
        assert len({len(values) for values in table.values()}) == 1


def test_results_without_what_is_needed_are_refused(tmp_path):
    file = tmp_path / "x.csv"
    file.write_text("task,policy,success\nt,p,true\n", "utf-8")
    with pytest.raises(InputError, match="lacks"):
        compose(file)
    with pytest.raises(InputError, match=re.escape("cannot be read")):
        compose(tmp_path / "nowhere.csv")


class Trace:
    def __init__(self, name, content=""):
        self.episode_id, self.content_hash = name, content


def drawn(packed_pieces, names, **more):
    """Evidence of some episodes, as if it had been gathered."""
    return Pieces(packed_pieces, names, more.get("films", {}), (), (), ())


@pytest.mark.slow
def test_a_great_campaign_fits_into_a_page_that_can_be_sent():
    rows = [row(i) for i in range(34_920)]
    dice = random.Random(5)
    # as long as the evidence of recorded episodes mostly is, and as hard to compress
    piece = packed("".join(f"{dice.random():.5f} <i> " for _ in range(9_500)))
    html = {f"e{i}": piece for i in range(250)}
    assert len(piece) > 36_000
    text = report_page(made_of(rows, pieces=drawn(html, {name: name for name in html})))
    assert len(text.encode()) <= 15_000_000
    assert len(text.partition('id="piece-')[0].encode()) < 500_000  # what is painted first


def test_a_folder_has_every_piece_in_a_file_of_its_own(tmp_path):
    film = tmp_path / "film.mp4"
    film.write_bytes(b"film")
    out = tmp_path / "report"
    data = prepared(out)
    (data / "e0.js").write_text("of the worker")
    report = made_of([row(0), row(1)], pieces=drawn({}, {"e0": "e0"}, films={"e0": film}))
    page = write_folder(report, out)
    assert page == out / "index.html"
    assert (out / "films" / "e0.mp4").read_bytes() == b"film"
    assert (data / "run.js").read_text().startswith('safestagePiece("run","')
    assert {path.name for path in (out / "lib").iterdir()} == {"three.min.js", "uplot.min.js"}
    assert "piece-" not in page.read_text("utf-8").partition("<script>")[0]
    prepared(out)  # again, into its own folder
    assert not (data / "e0.js").exists()
