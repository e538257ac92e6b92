"""Losses of single steps by kind, because the mean over all steps hides which of them dominate it."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from affmap.data.batches import Batch
from affmap.data.collect import read_dataset
from affmap.gaussian import nll
from affmap.model.stack import Stack
from affmap.results.files import EVERYWHERE, KINDS


def step_losses(stack: Stack, batches: Iterable[Sequence[Batch]]) -> Tensor:
    """Negative log-likelihood of every step, `[M, S, T]` in nats.

    Args:
        stack: M members.
        batches: consecutive chunks of some sequences at a time (`DataModule.val_dataloader`).
    """
    rows = []
    with torch.inference_mode():
        for chunks in batches:
            carry, parts = stack.transition.initial(chunks[0].action.shape[1]), []
            for chunk in chunks:
                carry, prediction = stack.transition.unroll(carry, stack.encode(chunk.views), chunk.delta, chunk.action)
                parts.append(nll(prediction, chunk.target))
            rows.append(torch.cat(parts, dim=2))
    return torch.cat(rows, dim=1)


def classify_steps(dataset: Path, sequences: np.ndarray) -> np.ndarray:
    """Kind of every step in some sequences of a data set: indices of `KINDS`, `[S, T]`.

    A vehicle is in fog where the reported position differs from the true one. Steps that touch a surface count as such
    if they neither begin nor end in fog.

    Raises:
        ConfigError: the file is corrupted.
    """
    arrays = read_dataset(dataset)
    in_fog = (arrays["position"] != arrays["true_position"]).any(-1)[sequences]
    before, after = in_fog[:, :-1], in_fog[:, 1:]
    conditions = [before & after, after, before, arrays["touching"][sequences]]
    names = ["inside", "entering", "leaving", "touching"]
    return np.select(conditions, [KINDS.index(name) for name in names], KINDS.index("free"))


def summarise(losses: Tensor, kinds: np.ndarray, worlds: Sequence[str], seeds: Sequence[int]) -> pd.DataFrame:
    """Summarise losses: one row per member, training world (and `EVERYWHERE`) and kind of step that occurs there.

    Args:
        losses: `[M, S, T]`, nats.
        kinds: `[S, T]`, of each step.
        worlds: `[S]`, name of the layout of each sequence.
        seeds: of the M members.

    Returns:
        The columns `member`, `world`, `kind`, `steps` (their number), `mean` and `median` (of their losses, nats).
    """
    values = losses.double().numpy()
    where = np.array(worlds)[:, None]
    rows = []
    for world in [*dict.fromkeys(worlds), EVERYWHERE]:
        for number, kind in enumerate(KINDS):
            mask = (kinds == number) & ((where == world) | (world == EVERYWHERE))
            if mask.any():
                of_kind = values[:, mask]  # [M, steps]
                centers = zip(seeds, of_kind.mean(1), np.median(of_kind, axis=1), strict=True)
                rows += [(seed, world, kind, of_kind.shape[1], mean, median) for seed, mean, median in centers]
    return pd.DataFrame(rows, columns=["member", "world", "kind", "steps", "mean", "median"])
