"""Files of a run: atomic writes, safe reads of untrusted files, digests and locks.

`guarded_read` and `read_arrays` raise ConfigError where a file is corrupted, and execute nothing in it.
"""

import errno
import hashlib
import json
import logging
import os
import pickle
import shutil
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from filelock import FileLock, Timeout
from safetensors import SafetensorError

from affmap.settings.messages import ConfigError, one_line

log = logging.getLogger("affmap")

CORRUPTION = (
    *(OSError, EOFError, ValueError, LookupError, TypeError, RuntimeError),
    *(BadZipFile, zlib.error, pickle.UnpicklingError, SafetensorError),
)
"""Errors of readers of arrays, tables, weights, checkpoints and JSON where a file is corrupted."""

FULL_DISK = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a disk, or of a user's share of it, that is full."""


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary file to write; at the end of the block it is synced to the disk and replaces `path`.

    A kill or a power cut at any moment leaves either the old file or the new one.
    """
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        with named_errors(path):
            yield temporary
            _sync(temporary)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    _sync(path.parent)


@contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Name the file that a block writes in its system errors: that of a full disk names none, or the source of a copy.

    Raises:
        OSError: of the block, with a file name.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None or error.errno in FULL_DISK:
            error.filename = str(path)
        raise


def replace_folder(new: Path, target: Path) -> None:
    """Let a complete folder take the place of `target`.

    A kill or a power cut at any moment leaves the old folder or the new one: as `target`, or, between two renames, the
    old one as `.<name>.old` beside it, from where the next call takes it back.
    """
    old = target.with_name(f".{target.name}.old")
    if old.exists() and not target.exists():
        old.rename(target)
    shutil.rmtree(old, ignore_errors=True)
    sync(new)
    if target.exists():
        target.rename(old)
    new.rename(target)
    _sync(target.parent)
    shutil.rmtree(old, ignore_errors=True)


def copy_files(source: Path, target: Path, names: Iterable[str]) -> None:
    """Copy files of a folder by name, as `target`, and nothing else; an earlier `target` is removed."""
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        with named_errors(target / name):
            shutil.copy(source / name, target / name)


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file atomically."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")


def sha256(path: Path) -> str:
    """The SHA-256 digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digests(folder: Path) -> dict[str, str]:
    """Name -> SHA-256 of every file below a folder, sorted by name."""
    paths = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: sha256(paths[name]) for name in sorted(paths)}


def sync(folder: Path) -> None:
    """Wait until all files below a folder, and their names, are on the disk."""
    for path in [*folder.rglob("*"), folder]:
        _sync(path)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def locked(path: Path, other: str) -> Iterator[None]:
    """Hold a lock for the block; waiting for `other` to release it is logged."""
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
    """Turn errors of a block that does nothing but read a file into a ConfigError.

    Raises:
        ConfigError: the file is corrupted; the message names file and remedy.
    """
    try:
        yield
    except ConfigError:
        raise
    except CORRUPTION as error:
        reason = one_line(str(error) or type(error).__name__, 200).rstrip(".")
        raise ConfigError(
            f"{path} cannot be read ({reason}): it is corrupted or not ours; remove its folder and run again."
        ) from None


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an `.npz`; none may hold Python objects, which would be pickled code.

    Raises:
        ConfigError: the file is corrupted.
    """
    with guarded_read(path), path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}
