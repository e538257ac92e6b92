"""A completed stage on disk: its configuration, its provenance, and the integrity of its files.

`provenance.json` lists the digests of the files, and has a checksum of its own.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from affmap import compiled
from affmap.store.attempt import Attempt, Seconds, is_scratch
from affmap.store.files import copy_files, digests, read_json, replace_folder, sha256, write_json
from affmap.store.provenance import (
    PROVENANCE,
    canonical,
    circumstances,
    extensions_of,
    has_valid_checksum,
    peak_memory,
    with_checksum,
)


class StoreError(Exception):
    """A file of the store cannot be used; the message names file and remedy."""


@dataclass(frozen=True)
class Stage:
    """A piece of work, with everything that its result depends on."""

    name: str
    config: Mapping[str, Any]
    """Plain, JSON-compatible values."""
    rules: Mapping[str, int] = field(default_factory=dict)
    """Stage -> version of its rules, for this stage and those before it; without versions 1."""

    @cached_property
    def digest(self) -> str:
        """The stage's name on disk; the order of the configuration's keys does not matter."""
        return hashlib.sha256(canonical({"name": self.name, **self.origin}).encode()).hexdigest()[:16]

    @property
    def configuration(self) -> str:
        """The digest of the configuration alone, as if all rules had version 1."""
        return replace(self, rules={}).digest if self.rules else self.digest

    @property
    def origin(self) -> dict[str, Any]:
        """Configuration and rules; without rules where all have version 1."""
        return {"config": self.config, **({"rules": dict(self.rules)} if self.rules else {})}


class _Record(BaseModel):
    """The provenance of a stage, as far as it is used."""

    model_config = ConfigDict(strict=True)

    stage: str
    digest: str
    config: dict[str, Any]
    rules: dict[str, int] = {}
    started: str
    seconds: Seconds
    peak_memory_mib: Seconds
    git: str | None
    versions: dict[str, str | None]
    machine: dict[str, str | int | None]
    files: dict[str, str]


def provenance(stage: Stage, attempt: Attempt) -> dict[str, Any]:
    """The provenance of a completed stage: configuration, versions, git state, machine, command, cost, files.

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
            **extensions_of(stage.config),
            "files": _digests(attempt.folder),
        }
    )


def _digests(folder: Path) -> dict[str, str]:
    """Digests of all files but those of the scratch folder."""
    return {name: digest for name, digest in digests(folder).items() if not is_scratch(name)}


def check(folder: Path, stage: Stage | None = None) -> dict[str, Any]:
    """Verify every file of a completed stage but those that systems left there; returns its provenance.

    Args:
        folder: of the stage.
        stage: the expected one; by default that of the folder's name.

    Raises:
        StoreError: a file is corrupted, missing or unexpected.
    """
    record = read(folder)
    digest = Stage(record["stage"], record["config"], record.get("rules", {})).digest
    if digest != record["digest"] or digest != (stage.digest if stage else folder.name):
        raise StoreError(f"{folder / PROVENANCE} is that of another stage; {remedy(folder)}")
    expected, actual = record["files"], _digests(folder)
    del actual[PROVENANCE]
    for name in sorted(expected.keys() | actual.keys()):
        if name not in expected:
            raise StoreError(f"{folder / name} does not belong there; remove that file and run the same command again.")
        if expected[name] != actual.get(name):
            raise StoreError(f"{folder / name} is {'corrupted' if name in actual else 'missing'}; {remedy(folder)}")
    return record


def check_file(folder: Path, name: str) -> dict[str, Any]:
    """Verify one file of a completed stage; returns the stage's provenance.

    Raises:
        StoreError: it is corrupted or missing, or its provenance is.
    """
    record = read(folder)
    path = folder / name
    if not path.is_file() or record["files"].get(name) != sha256(path):
        raise StoreError(f"{path} is corrupted or missing; {remedy(folder)}")
    return record


def copy_stage(source: Path, target: Path, patterns: Sequence[str]) -> None:
    """Copy those files of a completed stage that match one of `patterns`, replacing `target`.

    Raises:
        StoreError: a file is corrupted.
    """
    record = check(source)
    files = {name: digest for name, digest in record["files"].items() if any(fnmatch(name, each) for each in patterns)}
    new = target.with_name(f".{target.name}.new")
    copy_files(source, new, files)
    if _digests(new) != files:
        raise StoreError(f"{source} was changed while it was copied; run the same command again.")
    write_json(new / PROVENANCE, with_checksum({**record, "files": files}))
    replace_folder(new, target)


def read(folder: Path) -> dict[str, Any]:
    """The provenance of a completed stage.

    Raises:
        StoreError: it is corrupted.
    """
    path = folder / PROVENANCE
    try:
        record: dict[str, Any] = read_json(path)
        _Record.model_validate(record)
        if has_valid_checksum(record):
            return record
    except ValueError:
        pass
    raise StoreError(f"{path} is corrupted, or another version of affmap wrote it; {remedy(folder)}")


def remedy(folder: Path) -> str:
    """The remedy for a corrupted folder, as part of a sentence."""
    return f"remove the folder {folder} (or restore it) and run the same command again."
