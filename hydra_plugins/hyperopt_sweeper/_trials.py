"""Trials on disk: the checkpoint of a search, and its results.

`trials.jsonl` is JSON, a line each: the digest of the rest, the identity of the search, then the trials. Files are
written atomically, and reading an untrusted one executes nothing.
"""

import csv
import hashlib
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from omegaconf import OmegaConf
from pydantic import TypeAdapter

from hydra_plugins.hyperopt_sweeper._space import SearchError, TrialError

TRIALS = "trials.jsonl"
RESULTS = "results.csv"
BEST = "optimization_results.yaml"

_REMEDY = "remove that file, or choose another folder with hydra.sweep.dir"


@dataclass(frozen=True)
class Trial:
    """A finished trial."""

    trial: int
    """Its number, from 0."""
    point: dict[str, float]
    """hyperopt's numbers."""
    values: dict[str, Any]
    """The application's values."""
    result: float | None
    """Return value of the application; None if the trial failed."""
    error: str | None
    """The reason of a failure."""
    batch_seconds: float
    """Duration of its batch."""
    crashed: bool = False
    """Whether it failed for other reasons than its values; a line of the file says so only if it is true."""

    @property
    def status(self) -> Literal["ok", "fail"]:
        """Whether there is a result."""
        return "fail" if self.result is None else "ok"


_TRIAL = TypeAdapter(Trial)


def load(path: Path, search: Mapping[str, Any]) -> list[Trial]:
    """The trials of a file, none if it does not exist.

    Args:
        path: the file.
        search: the identity of the search, JSON only.

    Raises:
        SearchError: the file is corrupted, or belongs to another search.
    """
    if not path.exists():
        return []
    old, trials = read(path)
    new = json.loads(json.dumps(search))
    if old != new:
        keys = sorted(key for key in old.keys() | new.keys() if old.get(key) != new.get(key))
        changes = "; ".join(f"{key} was {_brief(old.get(key))} and is now {_brief(new.get(key))}" for key in keys)
        raise SearchError(
            f"{path} belongs to another search: {changes}; give the overrides that it began with, {_REMEDY}."
        )
    return trials


def read(path: Path) -> tuple[dict[str, Any], list[Trial]]:
    """The identity of the search in a file, and its trials.

    Raises:
        SearchError: the file is corrupted.
    """
    try:
        head, _, body = path.read_bytes().partition(b"\n")
        if json.loads(head) != {"sha256": hashlib.sha256(body).hexdigest()}:
            raise ValueError("another digest")
        search, *trials = body.splitlines()
        for trial in trials:
            _TRIAL.validate_json(trial, strict=True)
        return dict(json.loads(search)), [Trial(**json.loads(trial)) for trial in trials]
    except (ValueError, TypeError, RecursionError):
        raise SearchError(f"{path} is corrupted: it was cut off or edited; restore it, {_REMEDY}.") from None


def save(path: Path, search: Mapping[str, Any], trials: Sequence[Trial]) -> None:
    """Write all trials so far.

    Raises:
        TrialError: the file cannot be written, because the disk is full, say.
    """
    lines = [{key: value for key, value in asdict(trial).items() if key != "crashed" or value} for trial in trials]
    body = "".join(f"{json.dumps(line)}\n" for line in [search, *lines])
    head = json.dumps({"sha256": hashlib.sha256(body.encode()).hexdigest()})
    _write(path, f"{head}\n{body}")


def write_results(folder: Path, trials: Sequence[Trial], best: Trial | None) -> None:
    """Write the table of trials, and the best trial in the format of Hydra's other sweepers; both for readers only."""
    _write(folder / RESULTS, table(trials))
    if best:
        content = {"name": "hyperopt", "best_params": best.values, "best_value": best.result}
        _write(folder / BEST, OmegaConf.to_yaml(OmegaConf.create(content)))


def table(trials: Sequence[Trial]) -> str:
    """A table with a row for each trial, as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["trial", "status", "result", "batch_seconds", *(trials[0].values if trials else ())])
    for trial in trials:
        writer.writerow([trial.trial, trial.status, trial.result, trial.batch_seconds, *trial.values.values()])
    return text.getvalue()


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 200 else f"{text[:200]}..."


def _write(path: Path, text: str) -> None:
    new = path.with_name(f"{path.name}.new")
    try:
        with new.open("w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, path)
    except OSError as error:  # a full disk, whose error names no file
        raise TrialError(f"{path}: {error.strerror}; make room and run the same command again.") from error
