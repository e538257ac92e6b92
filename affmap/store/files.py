"""Files of a run: written whole or not at all, read without executing anything, with digests and locks.

Files may come from strangers: `guarded_read` and `read_arrays` raise ConfigError where one is corrupted.
"""

import hashlib
import json
import logging
import os
import pickle
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from filelock import FileLock, Timeout
from safetensors import SafetensorError

from affmap.settings.messages import ConfigError, one_line

log = logging.getLogger("affmap")

DAMAGE = (
    *(OSError, EOFError, ValueError, LookupError, TypeError, RuntimeError),
    *(BadZipFile, zlib.error, pickle.UnpicklingError, SafetensorError),
)
"""What readers of arrays, tables, weights, checkpoints and JSON raise where a file is not what it should be."""


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


@contextmanager
def guarded_read(path: Path) -> Iterator[None]:
    """Report a corrupted file of a run; to be put around code that reads it, and does nothing else.

    Raises:
        ConfigError: the file is not what it should be; the message names it and says what to do.
    """
    try:
        yield
    except ConfigError:
        raise
    except DAMAGE as error:
        reason = one_line(str(error) or type(error).__name__, 200).rstrip(".")
        raise ConfigError(
            f"{path} cannot be read ({reason}): it is damaged or not ours; remove its folder and run again."
        ) from None


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an `.npz`; none may hold Python objects, which would be pickled code.

    Raises:
        ConfigError: the file is not what it should be.
    """
    with guarded_read(path), path.open("rb") as file, np.load(file, allow_pickle=False) as found:
        return {name: found[name] for name in found.files}
