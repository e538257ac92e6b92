"""M members side by side: vision model and transition model, drawn from each member's own seed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import torch
from torch import Tensor, nn

from affmap.model.settings import ModelSettings as ModelSettings
from affmap.model.transition import TransitionModel
from affmap.model.vision import VisionModel
from affmap.model.windows import Windows
from affmap.random import integer
from affmap.settings.messages import counted


class Stack(nn.Module):
    """M independently seeded members: their transition models and, from context size 1 on, their vision models.

    Attributes:
        settings: those of the models.
        num_channels: K, channels of a view.
        seeds: of the M members.
        transition: the transition models.
        vision: the vision models; None at context size 0.
    """

    def __init__(
        self,
        settings: ModelSettings,
        num_channels: int,
        seeds: Sequence[int],
        transition: Callable[..., TransitionModel] | None = None,
    ) -> None:
        """Draw the initial weights of a member for each of `seeds` (M of them); K = `num_channels`.

        `transition` makes a transition model of your own in place of `settings.transition`: a class, or a function
        with the arguments of `affmap.model.registry.TransitionSettings.make`.
        """
        super().__init__()
        self.settings = settings
        self.num_channels = num_channels
        self.seeds = tuple(seeds)
        context_size = settings.context_size
        generators = [torch.Generator().manual_seed(integer(seed, "initial weights")) for seed in seeds]
        self._make = transition or settings.transition.make
        self.transition = self._make(generators, context_size, settings.hidden_size, settings.delta_scale)
        encoder = settings.code.encoder
        self.vision = VisionModel(generators, num_channels, context_size, encoder) if context_size > 0 else None

    def __repr__(self) -> str:
        members, kind = counted(len(self.seeds), "member"), type(self.transition).__name__
        weights = sum(each[0].numel() for each in self.parameters())
        return f"Stack({members}, C = {self.context_size}, K = {self.num_channels}, {kind}, {weights:,} weights each)"

    @property
    def context_size(self) -> int:
        """Length of the context code, C."""
        return self.settings.context_size

    def select(self, members: Sequence[int]) -> Stack:
        """Select members by their indices in this stack, as a new stack."""
        seeds = [self.seeds[member] for member in members]
        subset = Stack(self.settings, self.num_channels, seeds, self._make)
        subset.load_state_dict({name: weight[list(members)] for name, weight in self.state_dict().items()})
        return subset.to(next(self.parameters()).device)

    @classmethod
    def joined(cls, stacks: Sequence[Stack]) -> Stack:
        """Join the members of several stacks of the same settings, in their order, as a new stack."""
        first, seeds = stacks[0], [seed for stack in stacks for seed in stack.seeds]
        whole = cls(first.settings, first.num_channels, seeds, first._make)
        weights = [stack.state_dict() for stack in stacks]
        whole.load_state_dict({name: torch.cat([each[name] for each in weights]) for name in weights[0]})
        return whole.to(next(first.parameters()).device)

    def encode(self, windows: Windows) -> Tensor:
        """Context codes of views `[M or 1, ...]` (see `VisionModel.encode`): `[M, ..., C]`."""
        if self.vision is None:
            return windows.patches.new_zeros(len(self.seeds), *windows.ids.shape[1:], 0)
        return self.vision.encode(windows)


def readable(numbers: Iterable[Tensor]) -> bool:
    """Whether compiled code can read tensors: float32, on the CPU."""
    return all(tensor.is_cpu and tensor.dtype == torch.float32 for tensor in numbers)


def num_changes(weights: Iterable[Tensor]) -> int:
    """Counter that grows whenever weights change; inference tensors, whose changes PyTorch does not count, add 0."""
    return sum(0 if weight.is_inference() else weight._version for weight in weights)
