"""Other benchmarks' code, run from a checkout: single modules, classes or functions of it.

What they import and is not installed here (simulators, their robots) is replaced by empty modules,
whose every name is an empty class. Nothing of theirs is copied.
"""

from __future__ import annotations

import ast
import importlib
import importlib.abc
import importlib.machinery
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any


class _Any(type):
    """The kind of a class that has every name."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Any(name, (), {})


class _Empty(ModuleType):
    """A module that has every name."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.__path__: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        made = _Any(name, (), {})
        setattr(self, name, made)
        return made


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def __init__(self, roots: Iterable[str]) -> None:
        self.roots = tuple(roots)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if any(fullname == root or fullname.startswith(f"{root}.") for root in self.roots):
            return importlib.machinery.ModuleSpec(fullname, self, is_package=True)
        return None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        return _Empty(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


@contextmanager
def code_of(
    checkout: Path,
    packages: Iterable[str] = (),
    absent: Iterable[str] = (),
    given: Mapping[str, Mapping[str, Any]] | None = None,
) -> Iterator[None]:
    """Modules of a checkout can be imported, while this lasts.

    Args:
        checkout: root of the repository.
        packages: folders that are packages, whose own ``__init__`` is not run.
        absent: modules that are not installed, with all below them.
        given: module → what it is to have.
    """
    before = dict(sys.modules)
    finder = _Finder([*absent, *(given or {})])
    sys.meta_path.insert(0, finder)
    sys.path.insert(0, str(checkout))
    try:
        for package in packages:
            module = ModuleType(package)
            module.__path__ = [str(checkout / package.replace(".", "/"))]
            sys.modules[package] = module
        for name, parts in (given or {}).items():
            vars(importlib.import_module(name)).update(parts)
        yield
    finally:
        sys.path.remove(str(checkout))
        sys.meta_path.remove(finder)
        for name in set(sys.modules) - set(before):
            file = getattr(sys.modules[name], "__file__", None) or ""
            if isinstance(sys.modules[name], _Empty) or file.startswith(str(checkout)):
                del sys.modules[name]
        sys.modules.update(before)  # a package of theirs may be called like a module here


def functions(
    path: Path, names: Iterable[str], namespace: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Functions, methods (``Class.name``), classes or constants of a file, without running the rest of it.

    Raises KeyError for a name that the file does not have.
    """
    tree = ast.parse(path.read_text("utf-8"), str(path))
    found: dict[str, ast.stmt] = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node
        if isinstance(node, ast.ClassDef):
            found.update(
                {f"{node.name}.{n.name}": n for n in node.body if isinstance(n, ast.FunctionDef)}
            )
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found.update({target.id: node for target in targets if isinstance(target, ast.Name)})
    space: dict[str, Any] = dict(namespace or {})
    for name in names:
        node = found[name]
        if isinstance(node, ast.FunctionDef):
            node.decorator_list = []
        future = ast.parse("from __future__ import annotations").body
        exec(compile(ast.Module([*future, node], []), str(path), "exec"), space)
    return {name: space[name.rpartition(".")[2]] for name in names}


def defines(path: Path, name: str) -> bool:
    """A file has a class, function or method of that name; a text file has it as words."""
    if not path.is_file():
        return False
    if path.suffix != ".py":
        return not name or name in path.read_text("utf-8")
    try:
        functions(path, [])
        tree = ast.parse(path.read_text("utf-8"))
    except SyntaxError:
        return False
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{n.name}" for n in node.body if isinstance(n, ast.FunctionDef)}
        if isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return name in names
