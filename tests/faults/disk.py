"""Disks that are full or may not be written to."""

from __future__ import annotations

import resource
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

SIZE = 24 << 20


class Disk:
    """A small file system where one may be mounted, and otherwise a folder with a bound on files."""

    def __init__(self, place: Path, *, mounted: bool) -> None:
        self.place, self.mounted = place, mounted
        self.folder = place / "data"
        self._filler = place / "filler"

    def fill(self, free: int) -> Callable[[], None]:
        """Leave so many bytes; what is given back bounds a process where nothing is mounted."""
        if self.mounted:
            left = shutil.disk_usage(self.place).free - free
            self._filler.write_bytes(bytes(max(0, left)))
            return lambda: None

        def bound() -> None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (free, free))

        return bound

    def used(self) -> int:
        """Bytes that are taken."""
        return shutil.disk_usage(self.place).used

    def make_room(self) -> None:
        """Free again."""
        self._filler.unlink(missing_ok=True)

    @contextmanager
    def read_only(self) -> Iterator[None]:
        """Nothing can be written meanwhile."""
        if self.mounted:
            self._remount("ro")
        else:
            modes = [(path, path.stat().st_mode) for path in [self.place, *self.place.rglob("*")]]
            for path, mode in modes:
                path.chmod(mode & ~0o222)
        try:
            yield
        finally:
            if self.mounted:
                self._remount("rw")
            else:
                for path, mode in modes:
                    path.chmod(mode)

    def _remount(self, how: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{how}", str(self.place)], check=True)


@contextmanager
def small_disk(place: Path) -> Iterator[Disk]:
    """A file system of a few megabytes while the block runs, if this process may mount one."""
    place.mkdir(parents=True)
    mounted = False
    if shutil.which("mount"):
        command = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", str(place)]
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    try:
        yield Disk(place, mounted=mounted)
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(place)], check=True)
