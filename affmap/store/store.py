"""A cache of results on disk: each stage in a folder named by the digest of everything that it depends on.

A stage is written into `<digest>.partial` and renamed when complete, so that a folder named by a digest is complete;
its `provenance.json` lists the digests of its files. Jobs that need a stage while another makes it wait on a lock.
Knows nothing of the work in a stage.
"""

import fcntl
import logging
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from affmap.store.attempt import Attempt, last_attempt
from affmap.store.files import FULL_DISK, NO_LOCKS, digests, locked, sync, write_json
from affmap.store.provenance import PROVENANCE, other_versions
from affmap.store.stage import Stage, StoreError, check, provenance, read, remedy

log = logging.getLogger("affmap")


class State(NamedTuple):
    """The state of a stage."""

    name: str
    """`complete`, `running`, `failed`, `stopped` (interrupted), `missing`, `corrupted`, or `unknown` (no locks)."""
    seconds: float = 0.0
    """Duration of all attempts so far."""
    finished: int = 0
    """Finished parts of the work, out of `total`; both 0 if unknown."""
    total: int = 0
    error: str = ""
    """Error of the last attempt, or the corrupted file."""
    log: str = ""
    """Log file of the last attempt."""

    @property
    def seconds_left(self) -> float | None:
        """Estimate of the remaining time at the pace so far; None if unknown."""
        return self.seconds / self.finished * (self.total - self.finished) if self.finished else None


class Store:
    """Folders of completed stages: one place to write, others to read from."""

    def __init__(self, root: Path, read_only: Sequence[Path] = (), any_versions: bool = False) -> None:
        """Write below `root`; look in `read_only` first.

        With `any_versions`, stages made with other versions of packages are used, too; those in `read_only` always are.
        """
        self.root = root
        self._places = (*read_only, root)
        self._any_versions = any_versions

    def has(self, stage: Stage) -> bool:
        """Whether a stage is complete; its files are not verified."""
        return self._place(stage) is not None

    def find(self, stage: Stage) -> Path | None:
        """The folder of a completed stage, every file verified; or None.

        Raises:
            StoreError: a file is corrupted, or the stage was made with other versions of packages.
        """
        folder = self._place(stage)
        if folder:
            record = check(folder)
            if folder.is_relative_to(self.root):
                self._check_versions(folder, record["versions"])
        return folder

    def state(self, stage: Stage, check: bool = False) -> State:
        """The state of a stage, without waiting for a job that makes it; `check` verifies its files, too."""
        if folder := self._place(stage):
            try:
                if check:
                    self.find(stage)
                return State("complete", read(folder)["seconds"])
            except StoreError as error:
                return State("corrupted", error=str(error))
        final = self.root / stage.name / stage.digest
        note = last_attempt(final.with_suffix(".partial"))
        if note is None:
            return State("missing")
        ended = "failed" if note["error"] else "stopped"
        name = {True: "running", False: ended, None: "unknown"}[_is_locked(final.with_suffix(".lock"))]
        return State(name, note["seconds"], note["finished"], note["total"], note["error"] or "", note["log"] or "")

    def ensure(self, stage: Stage, build: Callable[[Attempt], None]) -> Path:
        """The folder of a stage; if it is not complete, `build` fills it first.

        `build` gets an attempt: an empty folder to write to, and a scratch folder that survives interruptions.

        Raises:
            StoreError: see `find`; or the disk is full.
        """
        if folder := self.find(stage):
            return folder
        final = self.root / stage.name / stage.digest
        final.parent.mkdir(parents=True, exist_ok=True)
        lock = final.with_suffix(".lock")
        with locked(lock, f"another job that makes {stage.name}/{stage.digest}"):
            folder = self.find(stage)  # another job may have made it while this one waited
            if not folder:
                self._complete(stage, final, build)
            lock.unlink(missing_ok=True)
        return folder or final

    def _complete(self, stage: Stage, final: Path, build: Callable[[Attempt], None]) -> None:
        if digests(final):
            raise StoreError(f"{final} has no {PROVENANCE}: it is corrupted; {remedy(final)}")
        partial = final.with_suffix(".partial")
        if not (partial / PROVENANCE).is_file():  # the last file of a stage
            self._build(stage, partial, build)
        check(partial, stage)
        shutil.rmtree(Attempt(partial).scratch, ignore_errors=True)
        shutil.rmtree(final, ignore_errors=True)  # empty but for what systems left there
        os.replace(partial, final)

    def _build(self, stage: Stage, partial: Path, build: Callable[[Attempt], None]) -> None:
        if earlier := last_attempt(partial):
            self._check_versions(partial, earlier["versions"])
        attempt = None
        try:
            attempt = Attempt.begin(partial)
            build(attempt)
            sync(partial)
            write_json(partial / PROVENANCE, provenance(stage, attempt))
        except Exception as error:
            if attempt:
                attempt.fail(error)
            if _is_full(self.root, error):
                raise StoreError(f"The disk of {partial} is full; make room and run the same command again.") from error
            raise

    def _check_versions(self, folder: Path, recorded: Mapping[str, str | None]) -> None:
        differences = other_versions(recorded)
        if differences and not self._any_versions:
            raise StoreError(
                f"{folder} was made with {differences}, and numbers may depend on it; remove it to make it anew, go "
                "back to those versions, or take it as it is with versions=any."
            )

    def _place(self, stage: Stage) -> Path | None:
        folders = (place / stage.name / stage.digest for place in self._places)
        return next((folder for folder in folders if (folder / PROVENANCE).is_file()), None)


def _is_full(root: Path, error: Exception) -> bool:
    """Whether an error comes from a full disk; libraries report it in ways of their own."""
    if isinstance(error, OSError) and error.errno in FULL_DISK:
        return True
    return root.exists() and shutil.disk_usage(root).free < 2**16


def _is_locked(path: Path) -> bool | None:
    """Whether a job holds a lock now, None if the disk has no locks; tested without writing: it may be read-only."""
    try:
        with path.open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        return None
    return False
