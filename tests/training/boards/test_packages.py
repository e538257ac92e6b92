"""Boards by their own packages, offline (`make slow`): they hold the losses of the table of a training."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from commands import COMMAND, ENVIRONMENT, TINY, jobs

from affmap.config.root import Config
from affmap.pipeline.stage import TRAIN
from affmap.training import boards

Losses = dict[str, list[tuple[int, float, float]]]
"""Name of a run -> (epoch, training NLL, validation NLL), as read from a board."""


def from_table(table: pd.DataFrame, prefix: str) -> Losses:
    """The same from a table of losses, by pandas."""
    columns = ["epoch", "training_nll", "validation_nll"]
    return {
        f"{prefix}member {member}": [*rows[columns].itertuples(index=False, name=None)]
        for member, rows in table.groupby("member")
    }


def test_every_logger_has_a_board() -> None:
    """The values of the key `logger` are the modules of the folder, and csv."""
    names = {path.stem for path in Path(boards.__file__).parent.glob("*.py")} - {"__init__", "members"}
    assert names == {*get_args(Config.model_fields["logger"].annotation)} - {"csv"}


def read_mlflow(folder: Path) -> Losses:
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{folder / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("single")
    assert experiment is not None
    found: Losses = {}
    for run in client.search_runs([experiment.experiment_id]):
        assert run.info.status == "FINISHED" and run.data.params["model.hidden_size"]
        curves = [client.get_metric_history(run.info.run_id, name) for name in ("training_nll", "validation_nll")]
        found[run.info.run_name or ""] = [
            (one.step, one.value, other.value) for one, other in zip(*curves, strict=True)
        ]
    return found


def read_trackio(folder: Path) -> Losses:
    script = """if True:
    import json, trackio
    from trackio.sqlite_storage import SQLiteStorage
    print(json.dumps({run.name: SQLiteStorage.get_logs("single", run.name) for run in trackio.Api().runs("single")}))
    """
    command, environment = [sys.executable, "-c", script], {**os.environ, "TRACKIO_DIR": str(folder / "trackio")}
    logs = json.loads(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    return {
        name: [(row["step"], row["training_nll"], row["validation_nll"]) for row in rows] for name, rows in logs.items()
    }


def read_wandb(folder: Path) -> Losses:
    """From the log of an offline run: blocks of 32 KiB, of records that are parts of protocol buffers (LevelDB's)."""
    from wandb.proto.wandb_internal_pb2 import Record

    found: Losses = {}
    for path in folder.glob("output/wandb/offline-run-*/*.wandb"):
        content, position, record = path.read_bytes(), 7, b""
        name, rows = "", []
        while position < len(content):
            if 32768 - position % 32768 < 7:
                position += 32768 - position % 32768
            length, kind = int.from_bytes(content[position + 4 : position + 6], "little"), content[position + 6]
            record += content[position + 7 : position + 7 + length]
            position += 7 + length
            if kind in (1, 4):  # whole, or the last part
                parsed = Record.FromString(record)
                record = b""
                name = parsed.run.display_name or name
                values = {
                    item.key or ".".join(item.nested_key): json.loads(item.value_json) for item in parsed.history.item
                }
                rows += [(values["_step"], values["training_nll"], values["validation_nll"])] if values else []
        assert name not in found
        found[name] = rows
    return found


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # the packages' own
@pytest.mark.parametrize(
    ("logger", "read"),
    [("mlflow", read_mlflow), ("trackio", read_trackio), ("wandb", read_wandb)],
    ids=["mlflow", "trackio", "wandb"],
)
def test_packages_show_what_the_table_says(tmp_path: Path, logger: str, read: Callable[[Path], Losses]) -> None:
    """Two settings in two workers, by the console script and without network, read by each package's own storage;
    made again, with the stages lost, they replace their runs. The names of the stages are those without a logger."""
    pytest.importorskip(logger)
    places = [f"{key}={tmp_path / key}" for key in ("store", "reference", "output")]
    swept = [*TINY[:-1], *places, "compiled=false", "model.context_size=0,1"]
    home = {"MLFLOW_TRACKING_URI": f"sqlite:///{tmp_path / 'mlflow.db'}", "TRACKIO_DIR": str(tmp_path / "trackio")}
    for _ in range(2):
        result = subprocess.run(
            [COMMAND, *swept, "hydra.launcher.n_jobs=2", f"logger={logger}"],
            cwd=tmp_path,
            env={**ENVIRONMENT, **home, "WANDB_API_KEY": ""},
            capture_output=True,
            text=True,
            timeout=600,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        losses: Losses = {}
        for config in jobs(tmp_path, "model.context_size=0,1"):
            stage = TRAIN.of(config)
            table = pd.read_csv(tmp_path / "store/train" / stage.digest / "validation.csv")
            losses |= from_table(table, f"{config.model.name}, {stage.digest[:8]}, ")
        found = read(tmp_path)
        assert found.keys() == losses.keys()
        for name, values in losses.items():
            np.testing.assert_allclose(found[name], values, rtol=1e-6, atol=1e-6, err_msg=name)
        (tmp_path / "store").rename(tmp_path / f"lost-{len(list(tmp_path.iterdir()))}")
