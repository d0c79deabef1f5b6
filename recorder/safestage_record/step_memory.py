"""Reads what every physics step changes in MuJoCo's data where it lies in memory.

An attribute of ``MjData`` takes 0.3 to 1 µs to read, the same number in memory 0.03 µs, and a physics step of a
small scene 10 µs. Where the numbers lie is found by trying, so that no version's layout is written down here. Where
they are not found, the attributes are read.
"""

from __future__ import annotations

import ctypes
import struct
from typing import Any, Callable

import numpy as np

from .record_error import RecordError

_MARK = 1_526_612_903
_BLOCK, _FARTHEST = 512, 1 << 22
"""Bytes that are searched at a time, and at most."""
_POINTERS = 4096
"""Bytes behind the time among which the pointer to the forces is searched, at most."""
_MOST_VIEWS = 4096
_FLOAT = 8
HEAD = struct.Struct("=ii")
"""Before the contacts and forces of a moment: how many there are of each."""
_offsets: dict[str, int] = {}
_join = b"".join


class StepMemory:
    """Time, number of contacts, contacts and constraint forces of ``MjData``, as they lie there.

    Attributes:
        time: ``.value`` is the simulation's time in s.
        windows: bytes of each part of a contact that is copied; none before the first contact.
        fields: by name the part that a field stands in, its offset there, and its type.
    """

    def __init__(self, data: Any, scratch: Any) -> None:
        """Find the numbers of ``data``; ``scratch`` are other data of its model, left as they were."""
        self._data = data
        self.time, self._ncon, self._nefc = _numbers(data, scratch)
        self._force = ctypes.c_uint64(0)  # until the pointer is found
        self._views: dict[tuple[int, int, int], tuple[Any, ...]] = {}
        self._start = self._size = 0
        self.windows: list[int] = []
        self.fields: dict[str, tuple[int, int, Any]] = {}
        self._parts: list[list[memoryview]] = []

    def copier(self) -> Callable[[], bytes]:
        """A function that copies contacts and constraint forces at this moment; nothing without a contact.

        Their numbers (two int32); of every part that of all contacts; the forces (float64, N or N m). Its
        names are local: in a simulation an attribute takes several times as long as in a loop of its own.
        """
        ncon, nefc, get, make = self._ncon, self._nefc, self._views.get, self._make_views

        def copy() -> bytes:
            count = ncon.value
            if not count:
                return b""
            width = nefc.value
            return _join(get((count, width, self._force.value)) or make(count, width))

        return copy

    def check(self) -> None:
        """Raise RecordError where MuJoCo keeps something elsewhere than it did."""
        data = self._data
        kept = data.time == self.time.value and data.ncon == self._ncon.value
        kept = kept and data.nefc == self._nefc.value
        if kept and self.fields and data.ncon:
            kept = min(_starts(_contact_fields(data.contact)).values()) == self._start
        if kept and self._force.value and data.nefc:
            kept = start_of(data.efc_force) == self._force.value
        if not kept:
            raise RecordError("MuJoCo moved its contacts; please report this with its version.")

    def _make_views(self, count: int, width: int) -> tuple[Any, ...]:
        if not self.fields:
            self._find_contacts()
        if not self._force.value:
            self._find_force()
        force = self._force.value or start_of(self._data.efc_force)
        for part, begin, size in zip(self._parts, self._begins, self.windows):
            for i in range(len(part), count):
                part.append(_bytes(self._start + i * self._size + begin, size))
        contacts = [view for part in self._parts for view in part[:count]]
        views = HEAD.pack(count, width), *contacts, _bytes(force, width * _FLOAT)
        if self._force.value:
            if len(self._views) > _MOST_VIEWS:
                self._views.clear()
            self._views[count, width, force] = views
        return views

    def _find_force(self) -> None:
        """Find the pointer to the forces by MuJoCo's attribute; it comes after the time."""
        force = self._data.efc_force
        if len(force) and isinstance(self.time, ctypes.c_double):
            after, sought = ctypes.addressof(self.time) + _FLOAT, start_of(force)
            places = (ctypes.c_uint64.from_address(after + i) for i in range(0, _POINTERS, _FLOAT))
            self._force = next((each for each in places if each.value == sought), self._force)

    def _find_contacts(self) -> None:
        """Find where contacts lie and how, by MuJoCo's own views of each field.

        Their memory does not move as long as the data live: contacts stand at the start of its arena.
        """
        found = _contact_fields(self._data.contact)
        starts = _starts(found)
        self._start, self._size = min(starts.values()), int(found["dist"].strides[0])
        self._begins: list[int] = []
        end = -1 << 30
        for name in sorted(starts, key=lambda name: starts[name]):
            kind, at = found[name].dtype, starts[name] - self._start
            if at > end + _GAP:
                self._begins.append(at - at % _FLOAT)
                self.windows.append(0)
            end = at + kind.itemsize * _WANTED.get(name, 2)
            self.windows[-1] = -((self._begins[-1] - end) // _FLOAT) * _FLOAT
            self.fields[name] = len(self.windows) - 1, at - self._begins[-1], kind
        self._parts = [[] for _ in self.windows]


_WANTED = {"efc_address": 1, "dist": 1, "dim": 1, "pos": 3, "frame": 9, "friction": 2}
"""Fields of a contact, and how many numbers of each."""
_GAP = 64
"""Bytes between two fields that are copied with them."""


def _contact_fields(contact: Any) -> dict[str, Any]:
    """MuJoCo's views (C, …) of contacts; ``geom`` (C,) or (C, 2) is where two ids stand."""
    fields: dict[str, Any] = {name: getattr(contact, name) for name in _WANTED}
    try:
        fields["geom"] = contact.geom
    except AttributeError:  # before MuJoCo 3
        fields["geom"] = contact.geom1
        second = start_of(contact.geom2) - start_of(contact.geom1)
        if second != contact.geom1.itemsize:
            raise RecordError("this MuJoCo's contacts cannot be read.") from None
    return fields


def _starts(fields: dict[str, Any]) -> dict[str, int]:
    return {name: start_of(values) for name, values in fields.items()}


def _bytes(address: int, size: int) -> memoryview:
    block: Any = (ctypes.c_char * size).from_address(address)
    return memoryview(block).cast("B")


class _Attribute:
    """A number that MuJoCo's attribute tells."""

    def __init__(self, data: Any, name: str) -> None:
        self._data, self._name = data, name

    @property
    def value(self) -> Any:
        """The current value."""
        return getattr(self._data, self._name)


def _numbers(data: Any, scratch: Any) -> tuple[Any, Any, Any]:
    """Time, number of contacts and of constraint forces of ``data``; ``.value`` reads them."""
    kinds: dict[str, Any] = {"time": ctypes.c_double, "ncon": ctypes.c_int, "nefc": ctypes.c_int}
    try:
        if not _offsets:
            _offsets.update({name: _find(scratch, name) for name in kinds})
        found = [kind.from_address(_base(data) + _offsets[name]) for name, kind in kinds.items()]
        if all(number.value == getattr(data, name) for name, number in zip(kinds, found)):
            return found[0], found[1], found[2]
    except (AttributeError, RecordError):  # another layout, or other bindings
        pass
    return _Attribute(data, "time"), _Attribute(data, "ncon"), _Attribute(data, "nefc")


def _find(scratch: Any, name: str) -> int:
    """Bytes from the start of ``MjData`` to its time, or to a number that lies before the time.

    Raises:
        RecordError: it stands nowhere.
    """
    kind = np.float64 if name == "time" else np.int32
    mark = np.array([_MARK], kind)
    base, before = _base(scratch), getattr(scratch, name)
    setattr(scratch, name, mark[0].item())
    try:  # more than a block of pointers comes after the time
        for at in range(0, _FARTHEST, _BLOCK):
            [found] = np.nonzero(np.frombuffer(_bytes(base + at, _BLOCK), kind) == mark)
            if len(found):
                return at + int(found[0]) * mark.itemsize
    finally:
        setattr(scratch, name, before)
    raise RecordError("this MuJoCo's data cannot be read; please report its version.")


def _base(data: Any) -> int:
    """Address of the ``mjData`` that a ``MjData`` wraps."""
    return int(data._address)  # noqa: SLF001 - MuJoCo's bindings have it for this purpose


def start_of(values: Any) -> int:
    """Address of an array's memory."""
    return int(values.__array_interface__["data"][0])
