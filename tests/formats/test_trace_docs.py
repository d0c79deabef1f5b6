"""The documentation and the schema files agree with the code."""

import json
import re
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from google.protobuf import descriptor_pb2
from recordings import falling_cube

from safestage_eval.formats import discover, validate
from safestage_eval.formats.mcap.mcap_messages import MESSAGES, schema_bytes
from safestage_eval.formats.parquet.arrow_tables import EPISODES, TABLES
from safestage_eval.formats.trace_schema import schema_files

ROOT = Path(__file__).parents[2]


def test_the_schema_files_are_up_to_date():
    for name, text in schema_files().items():
        stored = (ROOT / "schemas" / name).read_text("utf-8")
        assert stored == text, f"{name}: python -m safestage_eval.formats.trace_schema"


def test_the_proto_text_and_the_descriptor_say_the_same():
    text = schema_files()["trace.proto"]
    [file] = descriptor_pb2.FileDescriptorSet.FromString(schema_bytes()).file
    kinds = descriptor_pb2.FieldDescriptorProto
    for message in file.message_type:
        body = re.search(rf"message {message.name} {{(.*?)}}", text, re.DOTALL)[1]
        said = re.findall(r"^  (repeated|optional) (\w+) (\w+) = (\d+);", body, re.MULTILINE)
        assert said == [
            (
                "repeated" if f.label == kinds.LABEL_REPEATED else "optional",
                kinds.Type.Name(f.type).removeprefix("TYPE_").lower(),
                f.name,
                str(f.number),
            )
            for f in message.field
        ]
    assert [message.name for message in file.message_type] == list(MESSAGES)


def test_files_on_disk_have_the_published_tables(tmp_path):
    falling_cube().close(tmp_path)
    tables = json.loads(schema_files()["trace.tables.json"])["tables"]
    for table in ("meta/episodes", "bodies", "contacts", "frames", "geometry"):
        [file] = (tmp_path / table).glob("*.parquet")
        columns = [(field.name, str(field.type)) for field in pq.read_schema(file)]
        said = [(c["name"], c["type"]) for c in tables[table]]
        spelled = [(name, _arrow_name(kind)) for name, kind in said]
        assert columns == spelled


def _arrow_name(kind):
    kind = kind.replace(
        "dictionary<string, int16>", "dictionary<values=string, indices=int16, ordered=0>"
    )
    kind = re.sub(r"list<(\w+)>", r"list<element: \1>", kind)
    return kind.replace("float32", "float").replace("float64", "double")


def test_the_header_schema_accepts_a_stored_header(tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    falling_cube().close(tmp_path)
    schema = json.loads(schema_files()["trace.header.schema.json"])
    jsonschema.Draft202012Validator.check_schema(schema)
    header = discover(tmp_path)[0].open().header
    jsonschema.validate(json.loads(header.model_dump_json()), schema)


def test_the_documented_recorder_runs_and_its_episode_is_sound(tmp_path, monkeypatch):
    text = (ROOT / "docs/traces.md").read_text("utf-8")
    [code] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith("import")]
    assert len(lines) <= 30
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "docs/traces.md", "exec"), {})
    refs = discover(tmp_path)
    assert len(refs) == 1
    assert validate(tmp_path) == []
    assert len(refs[0].open().contacts) > 0


def test_every_column_is_documented():
    text = (ROOT / "docs/traces.md").read_text("utf-8")
    for table, columns in TABLES.items():
        assert f"`{table}`" in text
        for column in columns:
            assert f"`{column.partition('.')[0]}" in text, f"{table}.{column}"
    for column in EPISODES:
        assert f"`{column}`" in text, column
    for _, fields in MESSAGES.values():
        for field in fields:
            assert f"`{field.name}`" in text, field.name
