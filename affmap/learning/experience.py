"""The experience of an agent: rounds of flight, and batches of chunks of all of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from affmap.data.batches import Batch
from affmap.model.windows import take_apart
from affmap.results.files import Floats


class Round(NamedTuple):
    """The experience of one agent in the S steps of a round."""

    position: Floats
    """Reported positions, `[S + 1, 2]`, u."""
    true_position: Floats
    """True positions, `[S + 1, 2]`, u."""
    view: NDArray[np.bool_]
    """View before each step, `[S, K, 11, 11]`."""
    action: Floats
    """Throttles of each step, `[S, 4]`, in [0, 1]."""
    touching: NDArray[np.bool_]
    """Whether an obstacle or a border is touched after each step, `[S]`."""
    in_fog: NDArray[np.bool_]
    """Whether the vehicle is in fog then, `[S]`."""
    goal: Floats | None = None
    """The goal in each step, `[S, 2]`, u; None for agents that have none."""


def batches(
    rounds: Sequence[Round], batch_size: int, chunk_length: int, number: int, rng: np.random.Generator
) -> Iterator[Batch]:
    """Draw batches of chunks from the rounds of an agent, each chunk as likely as any other.

    A hidden state begins anew with each chunk.

    Args:
        rounds: R rounds of S steps each.
        batch_size: chunks of a batch; all of them where there are fewer.
        chunk_length: T, steps of a chunk; S is a multiple of it.
        number: number of batches.
        rng: chooses the chunks.
    """

    def chunks(parts: Sequence[np.ndarray]) -> Tensor:
        """Values of all steps, R times `[S, ...]`, by chunks: `[1, R * S / T, T, ...]`."""
        return torch.from_numpy(np.stack(parts)).flatten(0, 1).unflatten(0, (1, -1, chunk_length))

    changes = [np.diff(each.position, axis=0, prepend=each.position[:1]) for each in rounds]
    delta, target = chunks([change[:-1] for change in changes]), chunks([change[1:] for change in changes])
    action, views = chunks([each.action for each in rounds]), take_apart(chunks([each.view for each in rounds]))
    for _ in range(number):
        chosen = slice(None), torch.from_numpy(rng.permutation(action.shape[1])[:batch_size])
        yield Batch(views.select(chosen), delta[chosen], action[chosen], target[chosen], is_first=True)
