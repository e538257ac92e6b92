"""Results on disk: each stage in a folder named by the digest of the configuration that it depends on.

A stage is written into `<digest>.partial` and renamed when complete, so that a folder with a digest's name is whole.
A lock makes jobs that need the same stage at the same time wait for the one that makes it. Knows nothing of what the
stages are.
"""

import hashlib
import json
import logging
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from filelock import FileLock, Timeout

log = logging.getLogger("affmap")

PROVENANCE = "provenance.json"
PACKAGES = ("affmap", "torch", "lightning", "numpy", "box2d", "gymnasium", "hydra-core", "pandas", "scipy")


class Stage(NamedTuple):
    """A piece of work, and all that its result depends on."""

    name: str
    config: Mapping[str, Any]
    """Plain, JSON-compatible values."""

    @property
    def digest(self) -> str:
        """The stage's name on disk; equal configurations have equal digests, in whatever order their keys come."""
        return hashlib.sha256(canonical(self._asdict()).encode()).hexdigest()[:16]


def canonical(value: Any) -> str:
    """The one JSON text of a plain value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


class Store:
    """Folders of completed stages: one place to write, others to read from."""

    def __init__(self, root: Path, read_only: Sequence[Path] = ()) -> None:
        """Write below `root`; look in `read_only` first."""
        self.root = root
        self._places = (*read_only, root)

    def find(self, stage: Stage) -> Path | None:
        """The folder of a completed stage, or None."""
        folders = (place / stage.name / stage.digest for place in self._places)
        return next((folder for folder in folders if (folder / PROVENANCE).is_file()), None)

    def ensure(self, stage: Stage, build: Callable[[Path], None]) -> Path:
        """The folder of a stage; where it is not complete, `build` fills it first.

        `build` gets the folder to write into; after an interruption it may find there what it wrote before.

        Raises:
            FileExistsError: a folder that lacks its provenance, and so cannot be trusted, stands in the way.
        """
        if found := self.find(stage):
            return found
        final = self.root / stage.name / stage.digest
        final.parent.mkdir(parents=True, exist_ok=True)
        with _locked(final.with_suffix(".lock")):
            if found := self.find(stage):  # another job made it while this one waited
                return found
            if final.exists():
                raise FileExistsError(f"{final} has no {PROVENANCE}: it is damaged; remove it and run again.")
            partial = final.with_suffix(".partial")
            partial.mkdir(exist_ok=True)
            started, begin = time.strftime("%Y-%m-%dT%H:%M:%S%z"), time.monotonic()
            build(partial)
            record = provenance(stage, started, time.monotonic() - begin)
            (partial / PROVENANCE).write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
            os.replace(partial, final)
        return final


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a lock, and wait for it if another job has it."""
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        log.info("Waiting for another job that makes %s/%s.", path.parent.name, path.stem)
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def provenance(stage: Stage, started: str, seconds: float) -> dict[str, Any]:
    """Where a result comes from: configuration, versions, git state, machine, command, cost.

    `seconds` counts from when the stage was last started; memory is the peak of the process so far.
    """
    return {
        "stage": stage.name,
        "digest": stage.digest,
        "config": stage.config,
        "command": " ".join([Path(sys.argv[0]).name, *without_places(sys.argv[1:])]),
        "started": started,
        "seconds": round(seconds, 2),
        "peak_memory_mib": round(peak_memory(), 1),
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
        "git": _git(),
        "machine": {"system": platform.system(), "processor": platform.machine(), "cores": os.cpu_count()},
    }


def without_places(arguments: Sequence[str]) -> list[str]:
    """A command line's arguments but for absolute places on this machine, which say nothing of a result."""
    return [argument for argument in arguments if "=/" not in argument]


def peak_memory() -> float:
    """Largest memory of this process so far, MiB."""
    try:  # on Linux `ru_maxrss` begins with what the parent process had
        status = Path("/proc/self/status").read_text("utf-8")
        return int(status.split("VmHWM:")[1].split()[0]) / 2**10
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except ModuleNotFoundError:  # box2d is called box2d-py on some platforms
        return None


def _git() -> str | None:
    """The commit that the code comes from, `-dirty` if it was changed since; None outside a checkout."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        result = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    except OSError:  # no git on this machine
        return None
    return result.stdout.strip() or None
