"""CITATION.cff is a valid Citation File Format 1.2.0, and agrees with the package."""

import json
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]

yaml = pytest.importorskip("yaml")
jsonschema = pytest.importorskip("jsonschema")
pytest.importorskip("check_jsonschema", reason="the extra docs is not installed")

CITATION = yaml.safe_load((CHECKOUT / "CITATION.cff").read_text("utf-8"))
VENDOR = files("check_jsonschema") / "builtin_schemas" / "vendor"
SCHEMA = json.loads((VENDOR / "citation-file-format.json").read_text("utf-8"))


def problems(citation):
    return [error.message for error in jsonschema.Draft7Validator(SCHEMA).iter_errors(citation)]


def test_it_is_valid():
    assert problems(CITATION) == []


def test_it_agrees_with_the_package():
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))["project"]
    assert CITATION["license"] == project["license"]
