"""Trainings as calls without arguments, the form that CUDA graphs need: batches of one size lie on the device.

On a card `captured` makes a graph of an update; on a CPU it returns the update itself, so that everything but the
capture can be tried anywhere.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from affmap.config.root import Config
from affmap.data.batches import Batch
from affmap.model.windows import Windows
from affmap.pipeline.train import untrained
from affmap.training.module import TrainingModule

WARM_UP = 3
"""Updates before a capture: in the first one Adam makes its state, and libraries find their kernels."""


class Epoch(NamedTuple):
    """The N batches of an epoch, stacked; their views and windows padded to the largest numbers of distinct ones.

    Nothing refers to what is padded, so that it has no gradient, and changes sums in their order only.
    """

    views: Windows
    """`ids [N, 1, B, T]`, `window_ids [N, D, 16]` and `patch_ids [N, U, 9]`; all batches share the patches."""
    delta: Tensor
    """`[N, 1, B, T, 2]`, u/step."""
    action: Tensor
    """`[N, 1, B, T, 4]`"""
    target: Tensor
    """`[N, 1, B, T, 2]`, u/step."""

    @classmethod
    def of(cls, batches: Sequence[Batch], device: str) -> Self:
        """Stack batches of the same data set, equally many sequences and steps each, on a device."""
        views = [batch.views for batch in batches]
        windows = Windows(
            torch.stack([each.ids for each in views]),
            pad_sequence([each.window_ids for each in views], batch_first=True),
            pad_sequence([each.patch_ids for each in views], batch_first=True),
            views[0].patches,
        )
        return cls(
            Windows(*(part.to(device) for part in windows)),
            torch.stack([batch.delta for batch in batches]).to(device),
            torch.stack([batch.action for batch in batches]).to(device),
            torch.stack([batch.target for batch in batches]).to(device),
        )

    def batch(self, number: Tensor) -> Batch:
        """The batch of a number `[1]` that lies on the device as well, so that nothing waits for it.

        All count as the first chunks of their sequences: the paper's transition model has no hidden state.
        """
        *parts, patches = self.views
        ids, window_ids, patch_ids, delta, action, target = (
            part.index_select(0, number)[0] for part in (*parts, self.delta, self.action, self.target)
        )
        return Batch(Windows(ids, window_ids, patch_ids, patches), delta, action, target, is_first=True)


class Training:
    """The training of a job's stack on the batches of an epoch, again and again.

    Attributes:
        device: where it trains.
        nll: sums of the members' losses over all updates, `[M]` in nats; on the device, as all that an update touches.
        module: the stack in training.
    """

    def __init__(self, config: Config, epoch: Epoch) -> None:
        """Begin with the initial weights of a job, on the device of `epoch`."""
        self.device = epoch.delta.device
        self.module = TrainingModule(untrained(config), config.training).to(self.device)
        self.nll = torch.zeros(len(self.module.stack.seeds), device=self.device)
        self._optimizer = self.module.configure_optimizers()
        self._epoch = epoch
        self._number = torch.zeros(1, dtype=torch.int64, device=self.device)

    def update(self) -> None:
        """Train on the next batch."""
        self.nll += self.module.update(self._epoch.batch(self._number), self._optimizer)
        self._number.add_(1).remainder_(len(self._epoch.delta))

    def prepare_capture(self) -> None:
        """Let gradients be made anew, and the optimiser be captured.

        To be called after an update: a fused Adam on a card counts its steps there from the first one.
        """
        self._optimizer.zero_grad()
        for group in self._optimizer.param_groups:
            group["capturable"] = True


class Graph:
    """Updates of a training on a card, captured once as a CUDA graph and replayed by a call.

    Each graph is warmed up, captured and replayed on a stream of its own, and has memory and work space of its own; so
    graphs of several trainings may run at the same time. It keeps the training, whose tensors it reads and writes.
    """

    def __init__(self, training: Training) -> None:
        """Do `WARM_UP` updates, and capture another one without doing it."""
        self.training = training
        self._stream, self._graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
        self._stream.wait_stream(torch.cuda.current_stream())  # which has brought batches and weights
        with torch.cuda.stream(self._stream):
            for _ in range(WARM_UP):
                training.update()
        torch.cuda.current_stream().wait_stream(self._stream)
        training.prepare_capture()
        with torch.cuda.graph(self._graph, stream=self._stream):
            training.update()

    def __call__(self) -> None:
        """Do the next update."""
        with torch.cuda.stream(self._stream):
            self._graph.replay()


def captured(training: Training) -> Callable[[], None]:
    """A call that does the next update, a graph where the training is on a card; `WARM_UP` updates are done before."""
    if training.device.type == "cuda":
        return Graph(training)
    for _ in range(WARM_UP):
        training.update()
    return training.update
