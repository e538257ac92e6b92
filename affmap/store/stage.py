"""A completed stage on disk: what it depends on, where it comes from, and whether every file is as it was written.

`provenance.json` lists the digests of the files, and has a checksum of its own.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from affmap import compiled
from affmap.store.attempt import Attempt, is_scratch
from affmap.store.files import digests, sha256, write_json
from affmap.store.provenance import PROVENANCE, canonical, circumstances, has_valid_checksum, peak_memory, with_checksum


class StoreError(Exception):
    """What lies in the store cannot be used; the message names the file and the remedy."""


@dataclass(frozen=True)
class Stage:
    """A piece of work, and all that its result depends on."""

    name: str
    config: Mapping[str, Any]
    """Plain, JSON-compatible values."""
    rules: Mapping[str, int] = field(default_factory=dict)
    """Stage -> version of the rules that make its numbers, of this one and those that it starts from; without those
    of version 1."""

    @cached_property
    def digest(self) -> str:
        """The stage's name on disk; equal configurations have equal digests, in whatever order their keys come."""
        return hashlib.sha256(canonical({"name": self.name, **self.origin}).encode()).hexdigest()[:16]

    @property
    def configuration(self) -> str:
        """The digest that the stage would have if all of its rules had version 1: that of its configuration."""
        return replace(self, rules={}).digest if self.rules else self.digest

    @property
    def origin(self) -> dict[str, Any]:
        """All that the result depends on; where every rule has version 1, the configuration alone."""
        return {"config": self.config, **({"rules": dict(self.rules)} if self.rules else {})}


class _Record(BaseModel):
    """The provenance of a stage, as far as it is relied on."""

    model_config = ConfigDict(strict=True)

    stage: str
    digest: str
    config: dict[str, Any]
    rules: dict[str, int] = {}
    files: dict[str, str]


def provenance(stage: Stage, attempt: Attempt) -> dict[str, Any]:
    """Where a completed stage comes from: configuration, versions, git state, machine, command, cost, files.

    Memory is the peak of the process so far.
    """
    return with_checksum(
        {
            "stage": stage.name,
            "digest": stage.digest,
            **stage.origin,
            "started": attempt.started,
            "seconds": round(attempt.seconds, 2),
            "peak_memory_mib": round(peak_memory(), 1),
            **circumstances(),
            "compiled": compiled.enabled(),
            "files": _digests(attempt.folder),
        }
    )


def _digests(folder: Path) -> dict[str, str]:
    """Of all files that are, or will be, those of the completed stage."""
    return {name: digest for name, digest in digests(folder).items() if not is_scratch(name)}


def check(folder: Path, stage: Stage | None = None) -> dict[str, Any]:
    """Make sure that a completed stage is as it was written; returns its provenance.

    Args:
        folder: of the stage.
        stage: what it must be; by default what the folder's name says.

    Raises:
        StoreError: a file is damaged, missing or too many.
    """
    record = read(folder)
    made = Stage(record["stage"], record["config"], record.get("rules", {}))
    if made.digest != record["digest"] or made.digest != (stage.digest if stage else folder.name):
        raise StoreError(f"{folder / PROVENANCE} is that of another stage; {remedy(folder)}")
    expected, actual = record["files"], _digests(folder)
    del actual[PROVENANCE]
    for name in sorted(expected.keys() | actual.keys()):
        if expected.get(name) != actual.get(name):
            problem = "is missing" if name not in actual else "does not belong there"
            problem = "is damaged" if name in expected and name in actual else problem
            raise StoreError(f"{folder / name} {problem}; {remedy(folder)}")
    return record


def check_file(folder: Path, name: str) -> dict[str, Any]:
    """Make sure that one file of a completed stage is as it was written; returns the stage's provenance.

    Raises:
        StoreError: it is damaged or missing, or its provenance is.
    """
    record = read(folder)
    path = folder / name
    if not path.is_file() or record["files"].get(name) != sha256(path):
        raise StoreError(f"{path} is damaged or missing; {remedy(folder)}")
    return record


def copy_stage(source: Path, target: Path, patterns: Sequence[str]) -> None:
    """Copy a completed stage, but only those of its files that match one of `patterns`.

    Raises:
        StoreError: a file is damaged.
    """
    record = check(source)
    names = [name for name in record["files"] if any(fnmatch(name, pattern) for pattern in patterns)]
    partial = target.with_suffix(".partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    for name in names:
        (partial / name).parent.mkdir(exist_ok=True)
        shutil.copy(source / name, partial / name)
    write_json(
        partial / PROVENANCE, with_checksum({**record, "files": {name: record["files"][name] for name in names}})
    )
    shutil.rmtree(target, ignore_errors=True)
    os.replace(partial, target)


def read(folder: Path) -> dict[str, Any]:
    """The provenance of a completed stage.

    Raises:
        StoreError: it is damaged.
    """
    path = folder / PROVENANCE
    try:
        record = json.loads(path.read_text("utf-8"))
        _Record.model_validate(record)
        valid = has_valid_checksum(record)
    except ValueError:
        valid = False
    if not valid:
        raise StoreError(f"{path} is damaged, or another version of affmap wrote it; {remedy(folder)}")
    values: dict[str, Any] = record
    return values


def remedy(folder: Path) -> str:
    """What to do about a damaged folder."""
    return f"remove the folder {folder} (or restore it) and run the same command again."
