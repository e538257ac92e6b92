"""Trials on disk: what a killed search goes on from, and what it leaves behind.

`trials.jsonl` is JSON, a line each: the digest of all that follows, the search that the trials belong to, then the
trials. Opening a file executes nothing, whoever wrote it; each file is whole or not there.
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

from hydra_plugins.hyperopt_sweeper._space import SearchError

TRIALS = "trials.jsonl"
RESULTS = "results.csv"
BEST = "optimization_results.yaml"

_REMEDY = "remove that file, or choose another folder with hydra.sweep.dir"


@dataclass(frozen=True)
class Trial:
    """A trial that is over."""

    trial: int
    """Its number, from 0."""
    point: dict[str, float]
    """Where it was, as hyperopt has it."""
    values: dict[str, Any]
    """The same as the application got it."""
    result: float | None
    """What the application returned; None if the trial failed."""
    error: str | None
    """Why it failed."""
    batch_seconds: float
    """Time that its batch took."""

    @property
    def status(self) -> Literal["ok", "fail"]:
        """Whether there is a result."""
        return "fail" if self.result is None else "ok"


def load(path: Path, search: Mapping[str, Any]) -> list[Trial]:
    """The trials of a file, none if it is not there.

    Args:
        path: the file.
        search: what makes a search the same one, JSON only.

    Raises:
        SearchError: the file is damaged, or belongs to another search.
    """
    if not path.exists():
        return []
    found, trials = read(path)
    asked = json.loads(json.dumps(search))
    if found != asked:
        differing = sorted(key for key in found.keys() | asked.keys() if found.get(key) != asked.get(key))
        told = "; ".join(f"{key} was {_brief(found.get(key))} and is now {_brief(asked.get(key))}" for key in differing)
        raise SearchError(f"{path} belongs to another search: {told}; {_REMEDY}.")
    return trials


def read(path: Path) -> tuple[dict[str, Any], list[Trial]]:
    """The search that a file's trials belong to, and the trials.

    Raises:
        SearchError: the file is damaged.
    """
    try:
        head, _, body = path.read_bytes().partition(b"\n")
        if json.loads(head) != {"sha256": hashlib.sha256(body).hexdigest()}:
            raise ValueError("another digest")
        search, *trials = map(json.loads, body.splitlines())
        return dict(search), [Trial(**trial) for trial in trials]
    except (ValueError, TypeError):
        raise SearchError(f"{path} is damaged: it was cut off or edited; put it back as it was, {_REMEDY}.") from None


def save(path: Path, search: Mapping[str, Any], trials: Sequence[Trial]) -> None:
    """Replace the file by one of all trials so far."""
    body = "".join(f"{json.dumps(line)}\n" for line in [search, *map(asdict, trials)])
    head = json.dumps({"sha256": hashlib.sha256(body.encode()).hexdigest()})
    _write(path, f"{head}\n{body}")


def write_results(folder: Path, trials: Sequence[Trial], best: Trial | None) -> None:
    """A table with a row a trial, and the best trial as other sweepers of Hydra write it."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["trial", "status", "result", "batch_seconds", *trials[0].values])
    for trial in trials:
        writer.writerow([trial.trial, trial.status, trial.result, trial.batch_seconds, *trial.values.values()])
    _write(folder / RESULTS, table.getvalue())
    if best:
        content = {"name": "hyperopt", "best_params": best.values, "best_value": best.result}
        _write(folder / BEST, OmegaConf.to_yaml(OmegaConf.create(content)))


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 200 else f"{text[:200]}..."


def _write(path: Path, text: str) -> None:
    new = path.with_name(f"{path.name}.new")
    with new.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(new, path)
