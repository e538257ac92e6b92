"""A run for each member, recorded by lists, against the module's losses."""

from collections.abc import Mapping

import pytest
import torch

from affmap.model.stack import ModelSettings, Stack
from affmap.training.boards.members import MemberBoard
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

NUM_EPOCHS = 5


class Recorder:
    """Stands for a package whose runs are lists; one that is begun again replaces the former."""

    def __init__(self) -> None:
        self.runs: dict[str, list[tuple[int, dict[str, float]]]] = {}
        self.finished: list[str] = []

    def start(self, name: str) -> "RecordedRun":
        self.runs[name] = []
        return RecordedRun(self, name)


class RecordedRun:
    def __init__(self, recorder: Recorder, name: str) -> None:
        self._recorder, self._name = recorder, name

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        self._recorder.runs[self._name].append((step, dict(metrics)))

    def finish(self) -> None:
        self._recorder.finished.append(self._name)


def trained(seeds: tuple[int, ...], **changes: object) -> TrainingModule:
    """A module at the end of a training, with losses that are all different, and a diverged last member."""
    model = ModelSettings.load("model", "default", context_size=0)
    settings = TrainingSettings.load("training", "default", num_epochs=NUM_EPOCHS, **changes)
    module = TrainingModule(Stack(model, 1, seeds), settings)
    losses = torch.arange(2.0 * NUM_EPOCHS * len(seeds)).reshape(2, NUM_EPOCHS, len(seeds))
    losses[..., -1] = torch.nan
    module.training_nll, module.validation_nll = losses
    return module


def losses(module: TrainingModule, member: int, num_epochs: int) -> list[tuple[int, dict[str, float]]]:
    """The steps of a member, one by one from the module."""
    return [
        (
            epoch + 1,
            {
                "training_nll": module.training_nll[epoch, member].item(),
                "validation_nll": module.validation_nll[epoch, member].item(),
            },
        )
        for epoch in range(num_epochs)
    ]


@pytest.mark.parametrize("shown", [[1, 2, 3, 4, 5, 5], [3, 5], [5]], ids=["each epoch", "resumed", "at the end"])
def test_a_run_has_every_epoch_once(shown: list[int]) -> None:
    """Also those before an interruption, and where nothing was left to train; a member that diverged has NaN."""
    module, recorder = trained((4, 5, 6)), Recorder()
    board = MemberBoard(recorder.start)
    for num_epochs in shown:
        board.show(module, num_epochs)
        assert {len(steps) for steps in recorder.runs.values()} == {num_epochs}, "they can be seen meanwhile"
    board.close()
    assert [*recorder.runs] == recorder.finished == ["member 4", "member 5", "member 6"]
    for member, steps in enumerate(recorder.runs.values()):
        assert str(steps) == str(losses(module, member, NUM_EPOCHS))
    assert "nan" in str(recorder.runs["member 6"])


def test_a_member_of_each_trial_is_a_run() -> None:
    """Two trials of two members; names by hand."""
    module, recorder = trained((4, 5, 4, 5), transition_lr=[0.01, 0.001]), Recorder()
    MemberBoard(recorder.start).show(module, 2)
    names = ["trial 0, member 4", "trial 0, member 5", "trial 1, member 4", "trial 1, member 5"]
    assert [*recorder.runs] == names
    for member, name in enumerate(names):
        assert str(recorder.runs[name]) == str(losses(module, member, 2))


def test_a_board_of_nothing_begins_no_run() -> None:
    """A training that fails before its first epoch."""
    recorder = Recorder()
    MemberBoard(recorder.start).close()
    assert not recorder.runs and not recorder.finished
