"""Import of other people's recordings: one file per format, recognised by content, with an account of what is missing."""

from .account import Account
from .import_source import Outcome, import_all
from .importer import Importer, Settings
from .map_file import load_map
from .map_tables import MapFile

__all__ = [
    "Account",
    "Importer",
    "MapFile",
    "Outcome",
    "Settings",
    "import_all",
    "load_map",
]
