"""An attempt at a stage: scratch folder, progress, failure. Knows nothing of the work itself.

All attempts at a stage share its scratch folder, which is removed when the stage is complete.
"""

import logging
import os
import platform
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from affmap.store.files import is_left_behind, read_json, write_json
from affmap.store.provenance import has_valid_checksum, versions, with_checksum

SECONDS_BETWEEN_NOTES = 2.0

_UNFINISHED = "unfinished"
_NOTE = "attempt.json"

Seconds = Annotated[float, Field(ge=0, le=1e12)]
Count = Annotated[int, Field(ge=0, le=10**12)]


class _Note(BaseModel):
    """The note of an attempt, as far as it is used."""

    model_config = ConfigDict(strict=True)

    versions: dict[str, str | None]
    started: str
    log: str | None
    error: str | None
    finished: Count
    total: Count
    seconds: Seconds


@dataclass
class Attempt:
    """An attempt at a stage, new or resumed.

    Its progress is in `attempt.json` of the scratch folder, for others to read.
    """

    folder: Path
    """Folder of the results."""
    seconds_before: float = 0.0
    """Duration of earlier attempts."""
    _begin: float = field(default_factory=time.monotonic)
    _last_note: float = -SECONDS_BETWEEN_NOTES
    _note: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def begin(cls, folder: Path) -> "Attempt":
        """Begin, or resume an earlier attempt, of which only the scratch folder is kept."""
        earlier = last_attempt(folder) or {}
        attempt = cls(folder, earlier.get("seconds", 0.0))
        attempt.scratch.mkdir(parents=True, exist_ok=True)
        for path in folder.iterdir():
            if path != attempt.scratch and not is_left_behind(path.name):  # some cannot be removed
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        attempt._note = {
            "versions": earlier.get("versions") or versions(),
            "started": earlier.get("started") or time.strftime("%Y-%m-%dT%H:%M:%S%z"),
            "machine": platform.node(),
            "process": os.getpid(),
            "log": _log_file(),
            "error": None,
            "finished": 0,
            "total": 0,
        }
        attempt._write()
        return attempt

    @property
    def scratch(self) -> Path:
        """Folder for files that survive an interruption, such as checkpoints."""
        return self.folder / _UNFINISHED

    @property
    def started(self) -> str:
        """Time at which the first attempt began."""
        return str(self._note["started"])

    @property
    def seconds(self) -> float:
        """Duration of all attempts so far, each up to its last note."""
        return self.seconds_before + time.monotonic() - self._begin

    def progress(self, finished: int, total: int) -> None:
        """Note the progress; notes in quick succession are skipped."""
        if time.monotonic() - self._last_note > SECONDS_BETWEEN_NOTES:
            self._note |= {"finished": finished, "total": total}
            self._write()

    def fail(self, error: BaseException) -> None:
        """Note why this attempt ended; a full disk may prevent it."""
        self._note["error"] = f"{type(error).__name__}: {error}"
        try:
            self._write()
        except OSError:
            logging.getLogger("affmap").warning("The failure could not be noted in %s.", self.scratch)

    def _write(self) -> None:
        self._last_note = time.monotonic()
        write_json(self.scratch / _NOTE, with_checksum({**self._note, "seconds": round(self.seconds, 2)}))


def is_scratch(name: str) -> bool:
    """Whether a file of a stage's folder is in its scratch folder."""
    return name.startswith(f"{_UNFINISHED}/")


def last_attempt(folder: Path) -> dict[str, Any] | None:
    """The note of the last attempt at a stage; None if there was none, or the note is corrupted."""
    try:
        note: dict[str, Any] = read_json(folder / _UNFINISHED / _NOTE)
        _Note.model_validate(note)
    except (OSError, ValueError):
        return None
    return note if has_valid_checksum(note) else None


def _log_file() -> str | None:
    """The log file of this process."""
    handlers = logging.getLogger().handlers
    return next((each.baseFilename for each in handlers if isinstance(each, logging.FileHandler)), None)
