"""The trace format as schema files: ``python -m safestage_eval.formats.trace_schema [FOLDER]``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from safestage_eval.episode import SCHEMA_VERSION, Header

from .mcap.mcap_messages import proto_text
from .parquet.arrow_tables import EPISODES, REQUIRED, TABLES, Column


def schema_files() -> dict[str, str]:
    """Return file name → text: the Parquet tables, the protobuf messages and the header."""
    return {
        "trace.tables.json": _text(
            {
                "schema_version": SCHEMA_VERSION,
                "tables": {
                    name: _columns(columns)
                    for name, columns in {"meta/episodes": EPISODES, **TABLES}.items()
                },
                "required": {"meta/episodes": list(REQUIRED)},
            }
        ),
        "trace.proto": proto_text(),
        "trace.header.schema.json": _text(
            {"$schema": "https://json-schema.org/draft/2020-12/schema"} | Header.model_json_schema()
        ),
    }


def write_schemas(folder: Path) -> None:
    """Write the schema files into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in schema_files().items():
        (folder / name).write_text(text, "utf-8")


def _columns(columns: dict[str, Column]) -> list[dict[str, str]]:
    types = {"dictionary": "dictionary<string, int16>", "float": "float32", "double": "float64"}
    types |= {"list<float>": "list<float32>", "list<double>": "list<float64>"}
    return [
        {
            "name": name,
            "type": types.get(column.type, column.type),
            "unit": column.unit,
            "meaning": column.meaning,
        }
        for name, column in columns.items()
    ]


def _text(data: object) -> str:
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    write_schemas(Path(sys.argv[1] if len(sys.argv) > 1 else "schemas"))
