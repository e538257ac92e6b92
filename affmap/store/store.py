"""Results on disk: each stage in a folder named by the digest of all that it depends on.

A stage is written into `<digest>.partial` and renamed when complete, so that a folder with a digest's name is whole;
its `provenance.json` lists the digests of its files. A lock makes jobs that need the same stage at the same time wait
for the one that makes it. Knows nothing of what the stages are.
"""

import errno
import fcntl
import logging
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from affmap.store.attempt import Attempt, last_attempt
from affmap.store.files import locked, to_disk, write_json
from affmap.store.provenance import PROVENANCE, other_versions
from affmap.store.stage import Stage, StoreError, check, provenance, read, remedy

log = logging.getLogger("affmap")


class State(NamedTuple):
    """How a stage stands."""

    name: str
    """`complete`, `running`, `failed`, `stopped` (begun, and then interrupted), `missing` or `damaged`."""
    seconds: float = 0.0
    """Spent on it until now, by all attempts together."""
    finished: int = 0
    """Parts of the work that are done, out of `total`, where it is known."""
    total: int = 0
    error: str = ""
    """Why the last attempt failed, or what is damaged."""
    log: str = ""
    """The log of the last attempt."""

    @property
    def seconds_left(self) -> float | None:
        """What the rest will take if it goes on as until now; None where that is not known."""
        return self.seconds / self.finished * (self.total - self.finished) if self.finished else None


class Store:
    """Folders of completed stages: one place to write, others to read from."""

    def __init__(self, root: Path, read_only: Sequence[Path] = (), any_versions: bool = False) -> None:
        """Write below `root`; look in `read_only` first.

        With `any_versions`, what other versions of packages have made is used, too; in `read_only` it always is.
        """
        self.root = root
        self._places = (*read_only, root)
        self._any_versions = any_versions

    def has(self, stage: Stage) -> bool:
        """Whether a stage is complete; its files are not looked at."""
        return self._place(stage) is not None

    def find(self, stage: Stage) -> Path | None:
        """The folder of a completed stage, every file as it was written; or None.

        Raises:
            StoreError: a file is damaged, or other versions of packages have made the stage.
        """
        folder = self._place(stage)
        if folder:
            record = check(folder)
            if folder.is_relative_to(self.root):
                self._check_versions(folder, record["versions"])
        return folder

    def state(self, stage: Stage, check: bool = False) -> State:
        """How a stage stands, without waiting for whoever works on it; `check` looks at its files, too."""
        if folder := self._place(stage):
            try:
                if check:
                    self.find(stage)
                return State("complete", read(folder)["seconds"])
            except StoreError as error:
                return State("damaged", error=str(error))
        final = self.root / stage.name / stage.digest
        note = last_attempt(final.with_suffix(".partial"))
        if note is None:
            return State("missing")
        name = "running" if _is_locked(final.with_suffix(".lock")) else "failed" if note["error"] else "stopped"
        return State(name, note["seconds"], note["finished"], note["total"], note["error"] or "", note["log"] or "")

    def ensure(self, stage: Stage, build: Callable[[Attempt], None]) -> Path:
        """The folder of a stage; where it is not complete, `build` fills it first.

        `build` gets an empty folder to write into, and another where it may keep what an interruption should not cost.

        Raises:
            StoreError: see `find`; or the disk is full.
        """
        if found := self.find(stage):
            return found
        final = self.root / stage.name / stage.digest
        final.parent.mkdir(parents=True, exist_ok=True)
        lock = final.with_suffix(".lock")
        with locked(lock, f"another job that makes {stage.name}/{stage.digest}"):
            found = self.find(stage)  # another job may have made it while this one waited
            if not found:
                self._complete(stage, final, build)
            lock.unlink(missing_ok=True)
        return found or final

    def _complete(self, stage: Stage, final: Path, build: Callable[[Attempt], None]) -> None:
        if final.exists():
            raise StoreError(f"{final} has no {PROVENANCE}: it is damaged; {remedy(final)}")
        partial = final.with_suffix(".partial")
        if not (partial / PROVENANCE).is_file():  # which is the last file of a stage
            self._build(stage, partial, build)
        check(partial, stage)
        shutil.rmtree(Attempt(partial).scratch, ignore_errors=True)
        os.replace(partial, final)

    def _build(self, stage: Stage, partial: Path, build: Callable[[Attempt], None]) -> None:
        if before := last_attempt(partial):
            self._check_versions(partial, before["versions"])
        attempt = None
        try:
            attempt = Attempt.begin(partial)
            build(attempt)
            to_disk(partial)
            write_json(partial / PROVENANCE, provenance(stage, attempt))
        except Exception as error:
            if attempt:
                attempt.fail(error)
            if _is_full(self.root, error):
                raise StoreError(f"The disk of {partial} is full; make room and run the same command again.") from error
            raise

    def _check_versions(self, folder: Path, made_with: Mapping[str, str | None]) -> None:
        different = other_versions(made_with)
        if different and not self._any_versions:
            raise StoreError(
                f"{folder} was made with {different}, and numbers may depend on it; remove it to make it anew, go back "
                "to those versions, or take it as it is with versions=any."
            )

    def _place(self, stage: Stage) -> Path | None:
        folders = (place / stage.name / stage.digest for place in self._places)
        return next((folder for folder in folders if (folder / PROVENANCE).is_file()), None)


def _is_full(root: Path, error: Exception) -> bool:
    """Whether an error comes from a full disk; libraries tell that in ways of their own."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return True
    return root.exists() and shutil.disk_usage(root).free < 2**16


def _is_locked(path: Path) -> bool:
    """Whether a job holds a lock now; found out without writing, in somebody else's store, too."""
    try:
        with path.open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False
