"""Checks: what each sees in an episode, or in a campaign of them.

Every file here declares checks of one kind with ``@check`` above the function that carries each out.
All files are imported with the folder, so a new file needs no entry in any list.
"""

from importlib import import_module
from pkgutil import iter_modules

for _file in iter_modules(__path__):
    import_module(f"{__name__}.{_file.name}")
