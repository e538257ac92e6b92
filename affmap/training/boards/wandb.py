"""Losses of a running training for Weights & Biases (extra `[wandb]`): `wandb sync` sends those written offline."""

import hashlib
import os
import shutil
from typing import Any

import wandb

from affmap.training.boards import Training
from affmap.training.boards.members import MemberBoard, Run


def open_board(training: Training) -> MemberBoard:
    """Open a board with a run for each member; the experiment is the project, the training a group.

    Runs are offline where nobody is logged in, unless the environment variable WANDB_MODE says otherwise. Files are in
    the folder `wandb` of the training's folder.
    """
    is_known = "WANDB_MODE" in os.environ or wandb.login(prompt=False)
    options: dict[str, Any] = {} if is_known else {"mode": "offline"}

    def start(name: str) -> Run:
        # The same member has the same id, so that a training that is begun again replaces its run.
        key = hashlib.sha256(f"{training.experiment}, {training.label}, {name}".encode()).hexdigest()[:16]
        for old in training.folder.glob(f"wandb/offline-run-*-{key}"):
            shutil.rmtree(old)
        run: Run = wandb.init(
            project=training.experiment.replace("/", "-"),
            group=training.label,
            name=f"{training.label}, {name}",
            id=key,
            config={**training.config},
            dir=training.folder,
            reinit="create_new",
            settings=wandb.Settings(silent=True, console="off"),
            **options,
        )
        return run

    return MemberBoard(start)
