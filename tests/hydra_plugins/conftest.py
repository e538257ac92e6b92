"""A Hydra application inside the test process."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hydra
import pytest
from omegaconf import DictConfig, OmegaConf

from hydra_plugins.hyperopt_sweeper._trials import load

App = Callable[..., Path]

CONFIG = {"x": 0.0, "y": 0.0, "z": "a"}


@pytest.fixture
def app(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> App:
    """Runs `task` with overrides, and returns the sweep's folder; errors are raised as they are."""
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.chdir(tmp_path)

    def run(task: Callable[[DictConfig], Any], *overrides: str, folder: str = "sweep", config: Any = CONFIG) -> Path:
        conf = tmp_path / "conf"
        conf.mkdir(exist_ok=True)
        OmegaConf.save(OmegaConf.create(config), conf / "config.yaml")
        quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none", "hydra.output_subdir=null"]
        monkeypatch.setattr(
            sys, "argv", ["app.py", "-m", "hydra/sweeper=hyperopt", f"hydra.sweep.dir={folder}", *quiet, *overrides]
        )
        hydra.main(version_base="1.3", config_path=str(conf), config_name="config")(task)()
        return tmp_path / folder

    return run


@pytest.fixture
def stored() -> Callable[[Path], list[dict[str, Any]]]:
    """The trials in a folder, without the time that they took."""
    import json
    from dataclasses import asdict

    def read(folder: Path) -> list[dict[str, Any]]:
        path = folder / "trials.jsonl"
        trials = load(path, json.loads(path.read_text().splitlines()[1]))
        return [{key: value for key, value in asdict(trial).items() if key != "batch_seconds"} for trial in trials]

    return read
