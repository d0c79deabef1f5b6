"""The GitHub action: its scripts are run as its steps run them, against a server that answers as GitHub's."""

import json
import os
import re
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

yaml = pytest.importorskip("yaml")

TRACES = "ets_dumbbell_near_glasses.reference-unsafe", "fsh_orange_on_plate.reference-safe"


@pytest.fixture(scope="module")
def action(checkout):
    return yaml.safe_load((checkout / "action.yml").read_text("utf-8"))


def runs(action):
    return [step for step in action["runs"]["steps"] if "run" in step]


def test_steps_are_well_formed(action, checkout):
    assert action["runs"]["using"] == "composite"
    assert all(step["shell"] == "bash" for step in runs(action))
    scripts = re.findall(r"\$GITHUB_ACTION_PATH/([\w./]+)", json.dumps(action))
    assert {"action/score.sh", "action/comment.py"} == set(scripts)
    assert all((checkout / script).is_file() for script in scripts)


def test_no_input_becomes_code(action):
    """A caller's inputs reach scripts as environment variables alone."""
    assert [step["run"] for step in runs(action) if "${{" in step["run"]] == []


def test_every_input_is_used_and_every_output_is_given(action, checkout):
    text = json.dumps(action["runs"])
    assert {n for n in action["inputs"] if f"inputs.{n}" not in text} == set()
    script = (checkout / "action/score.sh").read_text("utf-8")
    assert {n for n in action["outputs"] if f'"{n}=$' not in script} == set()
    for step in runs(action):
        if "action/" in step["run"]:
            (path,) = re.findall(r"action/[\w.]+", step["run"])
            source = (checkout / path).read_text("utf-8")
            assert {name for name in step["env"] if name not in source} == set()


def judged(checkout, tmp_path, **asked):
    """Exit code told, folder of the report, and what the script printed."""
    output, summary = tmp_path / "output", tmp_path / "summary"
    env = {
        **os.environ,
        "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}",
        "OUT": str(tmp_path / "report"),
        "GITHUB_OUTPUT": str(output),
        "GITHUB_STEP_SUMMARY": str(summary),
        "PYTHONPATH": str(checkout),
        **asked,
    }
    (tmp_path / "bin").mkdir(exist_ok=True)
    command = tmp_path / "bin" / "safestage"
    command.write_text(
        f"#!{sys.executable}\nfrom safestage_eval.cli import main\nif __name__ == '__main__':\n    main()\n",
        "utf-8",
    )
    command.chmod(0o755)
    done = subprocess.run(
        ["bash", str(checkout / "action/score.sh")], cwd=tmp_path, env=env,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    outputs = (
        dict(line.split("=", 1) for line in output.read_text().splitlines())
        if output.exists()
        else {}
    )
    return done, outputs, tmp_path / "report", summary


@pytest.mark.slow
def test_it_judges_reports_and_tells_the_exit_code(checkout, tmp_path):
    traces = [next((checkout / "traces").glob(f"{name}*.mcap")) for name in TRACES]
    listed = "\n".join(f"  {path} " for path in traces)
    done, outputs, report, summary = judged(
        checkout, tmp_path, TRACES=listed, RULES="ets\nfsh\n", FAIL_ON="violation\n"
    )
    assert done.returncode == 0, done.stderr
    assert outputs == {"exit-code": "1", "report": str(report)}
    assert "::error title=ETS201" in done.stdout
    assert {path.name for path in report.iterdir()} == {
        "report.html", "results.parquet", "verdicts.md",
    }  # fmt: skip
    text = (report / "verdicts.md").read_text("utf-8")
    assert "ETS201" in text
    assert summary.read_text("utf-8") == text
    assert "ets_dumbbell_near_glasses" in (report / "report.html").read_text("utf-8")


class GitHub(BaseHTTPRequestHandler):
    """Keeps comments as GitHub does."""

    def _answer(self, content, code=200):
        data = json.dumps(content).encode()
        self.send_response(code)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _content(self):
        return json.loads(self.rfile.read(int(self.headers["Content-Length"])))

    def do_GET(self):
        page = int(re.search(r"&page=(\d+)", self.path)[1])
        self._answer(self.server.comments[(page - 1) * 100 : page * 100])

    def do_POST(self):
        if self.server.refuse:
            self._content()
            return self._answer({"message": "Resource not accessible"}, 403)
        assert self.path == "/repos/lab/arm/issues/7/comments"
        assert self.headers["Authorization"] == "Bearer secret"
        self.server.comments.append({"id": 1000, **self._content()})
        return self._answer({}, 201)

    def do_PATCH(self):
        number = int(self.path.rpartition("/")[2])
        (comment,) = [c for c in self.server.comments if c["id"] == number]
        comment |= self._content()
        self._answer({})

    def log_message(self, *_):
        pass


@pytest.fixture
def github():
    server = HTTPServer(("127.0.0.1", 0), GitHub)
    server.comments = [{"id": n, "body": f"comment {n}"} for n in range(150)]
    server.refuse = False
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


def comment(checkout, github, verdicts, run="https://example.org/run/1"):
    env = {
        **{
            name: value for name, value in os.environ.items() if not name.lower().endswith("_proxy")
        },
        "GITHUB_API_URL": f"http://127.0.0.1:{github.server_port}",
        "GITHUB_REPOSITORY": "lab/arm",
        "GITHUB_TOKEN": "secret",
        "PULL_REQUEST": "7",
        "VERDICTS": str(verdicts),
        "RUN": run,
    }
    return subprocess.run(
        [sys.executable, str(checkout / "action/comment.py")], env=env,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_a_later_run_changes_the_comment_of_the_first(checkout, github, tmp_path):
    verdicts = tmp_path / "verdicts.md"
    verdicts.write_text("**Judged 2 of 2 episodes.**\n", "utf-8")
    assert comment(checkout, github, verdicts).stdout == ""
    assert len(github.comments) == 151
    verdicts.write_text("**Judged 3 of 3 episodes.**\n", "utf-8")
    assert comment(checkout, github, verdicts).stdout == ""
    assert len(github.comments) == 151
    body = github.comments[-1]["body"]
    assert "Judged 3 of 3" in body
    assert "https://example.org/run/1" in body


def test_long_verdicts_are_cut_to_what_github_takes(checkout, github, tmp_path):
    verdicts = tmp_path / "verdicts.md"
    verdicts.write_text("- **ETS101** an episode\n" * 9000, "utf-8")
    comment(checkout, github, verdicts)
    body = github.comments[-1]["body"]
    assert 50_000 < len(body) < 65_536
    assert "… cut" in body
    assert "artifacts of this run" in body
