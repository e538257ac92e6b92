"""Boards: programs that show the losses of a running training. A module for each, with the name of its package.

They change no result. Each needs a package, the extra of its name.
"""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from affmap.training.module import TrainingModule


class Board(Protocol):
    """A board of one training."""

    def show(self, module: TrainingModule, num_epochs: int) -> None:
        """Write the losses of all new epochs up to `num_epochs`, including those before an interruption."""

    def close(self) -> None:
        """Write what is left, and end."""


class Training(NamedTuple):
    """A training, as boards name it."""

    experiment: str
    label: str
    """Its swept values, and something that no other training of the experiment has."""
    config: Mapping[str, Any]
    """The configuration that it depends on; plain values."""
    folder: Path
    """Folder for boards that keep files."""


def open_board(name: str, training: Training) -> Board:
    """Open the board of a module here; one of an interrupted training is begun again.

    Args:
        name: of the module, whose package must be installed.
        training: that is shown.
    """
    board: Board = import_module(f"{__name__}.{name}").open_board(training)
    return board
