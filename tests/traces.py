"""A trace of the renames and flushes of a test: nothing may get its name before its content is on the disk."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


class Trace:
    """Records what is flushed to the disk, and checks at each rename that what gets a new name was.

    Temporary names (`*.tmp`) are free. Fails the test at a rename of what was changed since it was flushed.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Trace `os.fsync` and all ways to rename until the test ends."""
        self.renamed: list[Path] = []
        """New names, in order."""
        self._flushed: dict[int, object] = {}
        fsync, replace, rename = os.fsync, os.replace, os.rename

        def traced_fsync(descriptor: int) -> None:
            fsync(descriptor)
            path = Path(f"/proc/self/fd/{descriptor}").resolve()
            self._flushed[path.stat().st_ino] = _content(path)

        def traced(move: Callable[..., None]) -> Callable[..., None]:
            def moving(source: Any, target: Any, **options: Any) -> None:
                if not os.fspath(target).endswith(".tmp"):
                    for path in [Path(source), *Path(source).rglob("*")]:
                        assert self.is_flushed(path), f"{path} is not on the disk when it is renamed to {target}"
                    self.renamed.append(Path(target))
                move(source, target, **options)

            return moving

        monkeypatch.setattr(os, "fsync", traced_fsync)
        monkeypatch.setattr(os, "replace", traced(replace))
        monkeypatch.setattr(os, "rename", traced(rename))

    def is_flushed(self, path: Path) -> bool:
        """Whether a file, or all names in a folder, are on the disk as they are now."""
        flushed, content = self._flushed.get(path.stat().st_ino), _content(path)
        if isinstance(content, set):  # names that are gone since do no harm
            return isinstance(flushed, set) and content <= flushed
        return flushed == content


def _content(path: Path) -> object:
    """The names in a folder; when a file was written, and its length."""
    return set(os.listdir(path)) if path.is_dir() else (path.stat().st_mtime_ns, path.stat().st_size)
