"""Files of a run: atomic writes, safe reads of untrusted files, digests and locks.

`guarded_read` and `read_arrays` raise ConfigError where a file is corrupted, and execute nothing in it.
"""

import errno
import hashlib
import json
import logging
import math
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

import numpy as np
from filelock import FileLock, Timeout

from affmap.settings.messages import ConfigError, one_line

log = logging.getLogger("affmap")

LARGEST_JSON = 2**27
"""Bytes; the largest of the paper has half a million. In memory a text takes up to thirty times as many."""

LEFT_BEHIND = (".*", "*~", "#*#", "Icon\r", "Thumbs.db", "desktop.ini", "lost+found", "@eaDir", "__MACOSX")
"""Names of what file systems, file managers and editors leave in folders. No file of ours has such a name."""

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP)
"""Errors of a lock on a disk that knows none."""

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


def is_left_behind(name: str) -> bool:
    """Whether a file, by its name relative to a folder of ours, is something that a system left there."""
    return any(fnmatch(part, pattern) for part in name.split("/") for pattern in LEFT_BEHIND)


def digests(folder: Path) -> dict[str, str]:
    """Name -> SHA-256 of every file below a folder but those that systems left there, sorted by name."""
    paths = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: sha256(paths[name]) for name in sorted(paths) if not is_left_behind(name)}


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


def check_locks(folder: Path) -> None:
    """Make sure that files of a folder, which is made if it is not there, can be locked.

    Raises:
        ConfigError: the disk has no locks.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f".{os.getpid()}.lock"
    with locked(path, "nobody"):
        path.unlink()


@contextmanager
def locked(path: Path, other: str) -> Iterator[None]:
    """Hold a lock for the block; waiting for `other` to release it is logged.

    Raises:
        ConfigError: the disk has no locks.
        OSError: the file cannot be made there.
    """
    lock = FileLock(path, fallback_to_soft=False)  # a lock that is a mere file outlives a killed job
    try:
        os.close(os.open(path, os.O_CREAT | os.O_RDWR))  # else FileLock would wait for ever, as in /proc
        lock.acquire(timeout=0)
    except Timeout:
        log.info("Waiting for %s.", other)
        lock.acquire(poll_interval=0.5)  # a thousand jobs that wait should not keep a file server busy
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        raise ConfigError(
            f"{path.parent} is on a disk without locks ({error.strerror}), which keep two jobs from writing the same "
            "files; mount it with locks, or say store= and output= with folders of another disk."
        ) from None
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
    except MemoryError:
        raise ConfigError(
            f"{path} cannot be read: it needs more memory than there is; read it on a larger machine or, if it is not "
            "ours, remove its folder and run again."
        ) from None
    except Exception as error:  # readers of a damaged file raise almost anything
        reason = one_line(str(error) or type(error).__name__, 200).rstrip(".")
        raise ConfigError(
            f"{path} cannot be read ({reason}): it is corrupted or not ours; remove its folder and run again."
        ) from None


def read_json(path: Path) -> Any:
    """The value of a JSON file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no JSON, or too large or too deeply nested for a file of ours.
    """
    if (size := path.stat().st_size) > LARGEST_JSON:
        raise ValueError(f"{size} bytes of JSON are too many")
    try:
        return json.loads(path.read_text("utf-8"))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an `.npz`; none may hold Python objects, which would be pickled code.

    Sizes are looked at before anything is read: in a file that was made to harm they are larger than its contents.

    Raises:
        ConfigError: the file is corrupted, or its arrays need more memory than the machine has.
    """
    with guarded_read(path), ZipFile(path) as archive:
        members = archive.infolist()
        total = sum(member.file_size for member in members)
        if total > _MOST_EXPANSION * path.stat().st_size:
            raise ValueError(f"{total} bytes cannot come out of so short a file")
        if total > os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"):
            raise MemoryError
        arrays = {}
        for member in members:
            with archive.open(member) as file:
                arrays[member.filename.removesuffix(".npy")] = _read_array(file, member.file_size)
        return arrays


_MOST_EXPANSION = 1032
"""Bytes that can come out of one of a compressed file (zlib's manual: 1032 to 1)."""


def _read_array(file: IO[bytes], size: int) -> np.ndarray:
    """The array of an `.npy` file of `size` bytes; `np.load` would trust its header."""
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError("an array is of another format than ours")
    shape, _, dtype = np.lib.format.read_array_header_1_0(file, max_header_size=1000)
    if dtype.kind not in "biuf":
        raise ValueError(f"an array has the type {dtype}")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != size - file.tell():
        raise ValueError(f"an array of {size} bytes cannot have the shape {shape}")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)
