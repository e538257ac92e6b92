"""The commands, run as a user runs them, at the tiniest scale."""

import logging
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from hydra.core.hydra_config import HydraConfig

from affmap.cli import publish, report, run, score, status
from affmap.config import sweep
from affmap.config.root import Config

COMMAND = Path(sys.executable).parent / "affmap"
TINY = [
    "scale=smoke",
    "members=2",
    "data.num_sequences=4",
    "data.num_validation=1",
    "data.num_steps=20",
    "training.num_epochs=2",
    "control.num_steps=3",
    "report.map_spacing=0.25",
    "lookup.spacing=0.25",
    "hydra.launcher.n_jobs=1",
]
COMMANDS = {
    "affmap": run.main,
    "affmap-status": status.main,
    "affmap-report": report.main,
    "affmap-publish": publish.main,
    "affmap-score": score.main,
}
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "COLUMNS": "200"}


def line(folder: Path, *overrides: str) -> list[str]:
    places = [f"store={folder / 'store'}", f"reference={folder / 'reference'}", f"output={folder / 'output'}"]
    return [*TINY, *places, *overrides]


def command(folder: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
    folder.mkdir(exist_ok=True)
    return subprocess.run(
        [COMMAND, *line(folder, *overrides)], cwd=folder, capture_output=True, text=True, env=ENVIRONMENT, timeout=120
    )


def in_process(monkeypatch: pytest.MonkeyPatch, entry: str, arguments: Sequence[str]) -> int:
    """The same function that the console script calls, with these arguments; its exit status."""
    monkeypatch.setattr(sys, "argv", [entry, *arguments])
    handlers = list(logging.root.handlers)
    try:
        COMMANDS[entry]()
    except SystemExit as leaving:
        return int(leaving.code or 0)
    finally:  # what Hydra leaves to the end of the process
        for handler in set(logging.root.handlers) - set(handlers):
            logging.root.removeHandler(handler)
            handler.close()
        HydraConfig.instance().cfg = None
    return 0


def contents(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Every file: when it was written, and what it holds."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {str(path.relative_to(folder)): (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


def jobs(folder: Path, *overrides: str) -> list[Config]:
    return sweep.jobs(sweep.complete(line(folder, *overrides)))
