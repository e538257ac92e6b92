"""The losses of a training for TensorBoard to draw while it lasts (extra `[tensorboard]`).

They are those of the table that every training leaves; of its many members, what a look can take in.
"""

from pathlib import Path
from typing import Self

import torch

from affmap.training.module import TrainingModule

QUARTILES = {"lower_quartile": 0.25, "median": 0.5, "upper_quartile": 0.75}


class Board:
    """A folder of TensorBoard's.

    The scalars `training_nll/median`, `training_nll/lower_quartile`, `training_nll/upper_quartile` and the same of
    `validation_nll`, in nats, over members, a step an epoch (from 1); with trials, of each: `trial_0/training_nll/...`.
    NaN where a member is lost.
    """

    def __init__(self, folder: Path) -> None:
        """Begin anew in `folder`: what an interrupted training has left there may lack epochs, or have too many."""
        from torch.utils.tensorboard import SummaryWriter  # TensorBoard may not be there

        for old in folder.glob("events.out.tfevents.*"):
            old.unlink()
        self._writer = SummaryWriter(str(folder))
        self._shown = 0

    def show(self, module: TrainingModule, num_epochs: int) -> None:
        """Show all of the first `num_epochs` epochs that have not been shown, also those before an interruption."""
        levels = torch.tensor([*QUARTILES.values()])
        for name in ("training_nll", "validation_nll"):
            losses = getattr(module, name)[self._shown : num_epochs].cpu()  # [epochs, M]
            trials = losses.unflatten(1, (module.settings.num_trials or 1, -1))
            for epoch, values in enumerate(trials, self._shown + 1):
                for trial, row in enumerate(values.quantile(levels, dim=1).T):
                    prefix = f"trial_{trial}/" if module.settings.num_trials else ""
                    for quartile, value in zip(QUARTILES, row.tolist(), strict=True):
                        self._writer.add_scalar(f"{prefix}{name}/{quartile}", value, epoch)
        self._shown = num_epochs
        self._writer.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()
