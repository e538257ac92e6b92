"""A run for each member, for boards that compare runs. Knows none of them."""

from collections.abc import Callable, Mapping
from typing import Protocol

from affmap.training.module import TrainingModule

LOSSES = ("training_nll", "validation_nll")


class Run(Protocol):
    """A run of a board's package."""

    def log(self, metrics: Mapping[str, float], step: int) -> object:
        """Write the values of a step."""

    def finish(self) -> object:
        """Write what is left, and end."""


class MemberBoard:
    """A board with a run for each member, named by its seed, or for each member of each trial.

    A run has the scalars `training_nll` and `validation_nll`, in nats, a step per epoch (from 1); NaN if the member has
    diverged.
    """

    def __init__(self, start: Callable[[str], Run]) -> None:
        """`start` begins a run under a name, in place of one of an interrupted training."""
        self._start = start
        self._runs: list[Run] = []
        self._written = 0

    def show(self, module: TrainingModule, num_epochs: int) -> None:
        """Write the losses of all new epochs up to `num_epochs`, including those before an interruption."""
        self._runs = self._runs or [self._start(name) for name in _names(module)]
        losses = {name: getattr(module, name)[self._written : num_epochs].tolist() for name in LOSSES}  # [epochs][M]
        for epoch in range(num_epochs - self._written):
            for member, run in enumerate(self._runs):
                values = {name: rows[epoch][member] for name, rows in losses.items()}
                run.log(values, step=self._written + epoch + 1)
        self._written = num_epochs

    def close(self) -> None:
        """Finish all runs."""
        for run in self._runs:
            run.finish()


def _names(module: TrainingModule) -> list[str]:
    """A name for each member: its seed, after its trial if there are several."""
    names = [f"member {seed}" for seed in module.stack.seeds]
    if not (num_trials := module.settings.num_trials):
        return names
    return [f"trial {index * num_trials // len(names)}, {name}" for index, name in enumerate(names)]
