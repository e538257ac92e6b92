"""Files that are whole or not there, their digests, and locks (leaf)."""

import hashlib
import json
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

log = logging.getLogger("affmap")


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """A temporary place to write a file to; at the end of the block it is on the disk, and takes `path`'s place.

    A kill or a power cut at any moment leaves either the old file or the new one.
    """
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        _to_disk(temporary)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    _to_disk(path.parent)


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file, whole or not at all."""
    with written(path) as temporary:
        temporary.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")


def sha256(path: Path) -> str:
    """The digest of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digests(folder: Path) -> dict[str, str]:
    """Name -> SHA-256 of every file below a folder, in the order of the names."""
    paths = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: sha256(paths[name]) for name in sorted(paths)}


def to_disk(folder: Path) -> None:
    """Wait until all files below a folder, and their names, are on the disk."""
    for path in [*folder.rglob("*"), folder]:
        _to_disk(path)


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def locked(path: Path, other: str) -> Iterator[None]:
    """Hold a lock, and wait for it if `other` has it, which is told."""
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        log.info("Waiting for %s.", other)
        lock.acquire(poll_interval=0.5)  # a thousand jobs that wait should not keep a file server busy
    try:
        yield
    finally:
        lock.release()
