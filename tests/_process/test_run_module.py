"""Command lines of installed packages."""

import pytest

from safestage_eval._process.run_module import run_module
from safestage_eval.errors import InputError


def test_a_package_does_what_its_command_line_says(tmp_path):
    (tmp_path / "some.json").write_text('{"a":1}', "utf-8")
    run_module("json.tool", str(tmp_path / "some.json"), str(tmp_path / "other.json"))
    assert (tmp_path / "other.json").read_text("utf-8").split() == ["{", '"a":', "1", "}"]


def test_a_failure_is_reported_with_the_last_line_printed(tmp_path):
    with pytest.raises(InputError, match=r"json\.tool .*missing\.json.*failed: .*missing\.json"):
        run_module("json.tool", str(tmp_path / "missing.json"))
