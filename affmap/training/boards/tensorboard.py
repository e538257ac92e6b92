"""Losses of a running training for TensorBoard (extra `[tensorboard]`).

They are those of the table of losses, summarised by quartiles over members.
"""

from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

from affmap.training.boards import Training
from affmap.training.module import TrainingModule

QUARTILES = {"lower_quartile": 0.25, "median": 0.5, "upper_quartile": 0.75}


class TensorBoard:
    """Writer of a folder for TensorBoard.

    The scalars `training_nll/median`, `training_nll/lower_quartile`, `training_nll/upper_quartile` and the same for
    `validation_nll`, in nats, over members, one step per epoch (from 1); with trials, for each: `trial_0/...`. NaN if a
    member has diverged.
    """

    def __init__(self, folder: Path) -> None:
        """Start afresh in `folder`: files of an interrupted training may lack epochs or have too many."""
        for old in folder.glob("events.out.tfevents.*"):
            old.unlink()
        self._writer = SummaryWriter(str(folder))
        self._written = 0

    def show(self, module: TrainingModule, num_epochs: int) -> None:
        """Write the losses of all new epochs up to `num_epochs`, including those before an interruption."""
        for name in ("training_nll", "validation_nll"):
            losses = getattr(module, name)[self._written : num_epochs].cpu()  # [epochs, M]
            levels = losses.new_tensor([*QUARTILES.values()])
            trials = losses.unflatten(1, (module.settings.num_trials or 1, -1))
            for epoch, values in enumerate(trials, self._written + 1):
                for trial, row in enumerate(values.quantile(levels, dim=1).T):
                    prefix = f"trial_{trial}/" if module.settings.num_trials else ""
                    for quartile, value in zip(QUARTILES, row.tolist(), strict=True):
                        self._writer.add_scalar(f"{prefix}{name}/{quartile}", value, epoch)
        self._written = num_epochs
        self._writer.flush()

    def close(self) -> None:
        """Close the folder's file."""
        self._writer.close()


def open_board(training: Training) -> TensorBoard:
    """Open a folder of the training's own in the folder `tensorboard` of its folder."""
    return TensorBoard(training.folder / "tensorboard" / training.label)
