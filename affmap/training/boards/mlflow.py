"""Losses of a running training for MLflow (extra `[mlflow]`): `mlflow ui` draws them."""

import time
from collections.abc import Mapping

import mlflow
from mlflow import MlflowClient
from mlflow.entities import Metric, Param

from affmap.results.provenance import leaves
from affmap.store.files import locked
from affmap.training.boards import Training
from affmap.training.boards.members import MemberBoard

GROUP = "training"
"""Tag of a run with the label of its training."""


class _Run:
    """A run that is no global state of MLflow, so that many are open at once."""

    def __init__(self, client: MlflowClient, id: str) -> None:
        self._client, self._id = client, id

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        now = int(1000 * time.time())
        self._client.log_batch(self._id, [Metric(name, value, now, step) for name, value in metrics.items()])

    def finish(self) -> None:
        self._client.set_terminated(self._id)


def open_board(training: Training) -> MemberBoard:
    """Open a board with a run for each member, of an MLflow experiment with the experiment's name.

    Files are where MLflow keeps them (environment variable MLFLOW_TRACKING_URI).
    """
    training.folder.mkdir(parents=True, exist_ok=True)
    with locked(training.folder / "mlflow.lock", "another job that opens MLflow"):  # the first one makes its tables
        experiment = mlflow.set_experiment(training.experiment).experiment_id
        client = MlflowClient()
        for old in client.search_runs([experiment], f"tags.{GROUP} = '{training.label}'"):
            client.delete_run(old.info.run_id)

    def start(name: str) -> _Run:
        tags = {GROUP: training.label}
        run = client.create_run(experiment, tags=tags, run_name=f"{training.label}, {name}").info.run_id
        client.log_batch(run, params=[Param(key, str(value)) for key, value in leaves({**training.config}).items()])
        return _Run(client, run)

    return MemberBoard(start)
