"""Training: a stack of members against plain PyTorch, one model at a time, and against a stock Lightning loop.

And a stack of trials, as a search for learning rates trains them, against one training a trial.
"""

import logging
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import lightning
import torch
from flights import EPOCHS, SETTINGS, PlainBatch, batches, data_module, plain_batches
from measure import Contender, Result, compare
from plain import PlainModel, PlainModule
from torch import Tensor, nn
from torch.utils.data import DataLoader

from affmap.data.batches import Batch, DataModule
from affmap.model.stack import ModelSettings, Stack
from affmap.model.vision import sizes
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

MEMBERS, CONTEXT_SIZE = 25, 8
TRIALS, TRIAL_MEMBERS = 10, 5
SAMPLES = 500
"""Of a batch."""

MAX_NORMS = (SETTINGS.transition_max_norm, SETTINGS.vision_max_norm)


def results(rounds: int) -> list[Result]:
    """The loops against each other: by hand on prepared batches, and by Lightning, which fetches them."""
    own, plain = batches(), plain_batches()
    stack = make_stack(MEMBERS, CONTEXT_SIZE)
    model = PlainModel(stack)
    check(stack, own[0], model, plain[0])
    by_hand = [
        Contender(f"stack of {MEMBERS}", updates(stack, own), MEMBERS * len(own)),
        Contender("plain PyTorch", plain_updates(model, plain), len(plain)),
        Contender(f"plain PyTorch, vmap over {MEMBERS}", mapped_updates(stack, plain), MEMBERS * len(plain)),
    ]
    by_lightning = [
        Contender(f"stack of {MEMBERS}", fit(stack, data_module()), MEMBERS * EPOCHS * len(own)),
        Contender("plain model, stock Lightning", plain_fit(model, plain), EPOCHS * len(plain)),
    ]
    unit, useful = "model and update", flop(stack)
    work = f"{SAMPLES} samples, context size {CONTEXT_SIZE}"
    return [
        *compare(f"training by hand, {work}", unit, by_hand, useful, rounds),
        *compare(f"training by Lightning, {work}", unit, by_lightning, useful, rounds),
        *compare(f"search, {TRIALS} trials of {TRIAL_MEMBERS} members", "trial", search(), rounds=rounds),
    ]


def search() -> list[Contender]:
    """Trials of learning rates that become smaller, side by side and one after the other; a call trains all of them."""
    rates = {
        key: [getattr(SETTINGS, key) * 0.8**trial for trial in range(TRIALS)] for key in ("vision_lr", "transition_lr")
    }
    settings = TrainingSettings.load("training", "default", num_epochs=EPOCHS, **rates)
    together = fit(make_stack(TRIALS * TRIAL_MEMBERS, CONTEXT_SIZE), data_module(), settings)
    alone = [
        fit(
            make_stack(TRIAL_MEMBERS, CONTEXT_SIZE),
            data_module(),
            SETTINGS.model_copy(update={key: values[trial] for key, values in rates.items()}),
        )
        for trial in range(TRIALS)
    ]
    return [
        Contender("one stack", together, TRIALS),
        Contender("one training a trial", lambda: [run() for run in alone], TRIALS),
    ]


def make_stack(members: int, context_size: int, channels: int = 1) -> Stack:
    """An untrained stack."""
    return Stack(ModelSettings.load("model", "default", context_size=context_size), channels, range(members))


def updates(stack: Stack, own: Sequence[Batch]) -> Callable[[], None]:
    """A call trains `stack` on each of the batches."""
    module = TrainingModule(stack, SETTINGS)
    optimizer = module.configure_optimizers()

    def run() -> None:
        for batch in own:
            module.update(batch, optimizer)

    return run


def plain_updates(model: PlainModel, plain: Sequence[PlainBatch]) -> Callable[[], None]:
    """A call trains `model` on each of the batches."""
    optimizer = model.optimizer()

    def run() -> None:
        for batch in plain:
            loss = model(batch)
            optimizer.zero_grad()
            loss.backward()
            for group, max_norm in zip(optimizer.param_groups, MAX_NORMS, strict=True):
                nn.utils.clip_grad_norm_(group["params"], max_norm)
            optimizer.step()

    return run


def mapped_updates(stack: Stack, plain: Sequence[PlainBatch]) -> Callable[[], None]:
    """A call trains plain models of all members of `stack` at once: what torch itself has for many seeds.

    Without clipping, which vmap leaves to its user.
    """
    models = [PlainModel(stack, member) for member in range(len(stack.seeds))]
    weights, _ = torch.func.stack_module_state(models)
    optimizer = torch.optim.Adam(weights.values(), SETTINGS.transition_lr, eps=SETTINGS.adam_eps, fused=True)

    def losses(own: dict[str, Tensor], batch: PlainBatch) -> Tensor:
        return torch.func.functional_call(models[0], own, (batch,))

    def run() -> None:
        for batch in plain:
            loss = torch.func.vmap(losses, in_dims=(0, None))(weights, batch).sum()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()

    return run


def fit(stack: Stack, data: DataModule, settings: TrainingSettings = SETTINGS) -> Callable[[], None]:
    """A call trains `stack` for some epochs as `affmap.training.fit` does, without validation and checkpoints."""
    module = TrainingModule(stack, settings)
    return lambda: trainer(reload_dataloaders_every_n_epochs=1, limit_val_batches=0).fit(module, data)


def plain_fit(model: PlainModel, plain: Sequence[PlainBatch]) -> Callable[[], None]:
    """A call trains `model` for some epochs; stock Lightning clips one norm over all weights."""
    module = PlainModule(model)
    loader: DataLoader[PlainBatch] = DataLoader(plain, batch_size=None)  # type: ignore[arg-type]
    return lambda: trainer(gradient_clip_val=max(MAX_NORMS)).fit(module, loader)


def trainer(**settings: Any) -> lightning.Trainer:
    """A trainer that writes nothing, to the disk or the terminal."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=".*LeafSpec.* is deprecated")
    warnings.filterwarnings("ignore", message=".*does not have many workers")
    return lightning.Trainer(
        accelerator="cpu",
        max_epochs=EPOCHS,
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        **settings,
    )


def check(stack: Stack, own: Batch, model: PlainModel, plain: PlainBatch) -> None:
    """Make sure that both do the same work.

    Raises:
        RuntimeError: the first member's loss is not that of its copy.
    """
    ours, theirs = TrainingModule(stack, SETTINGS).loss(own)[0].item(), model(plain).item()
    if abs(ours - theirs) > 1e-4:
        raise RuntimeError(
            f"On the same batch and weights the stack's loss is {ours:.6f}, the plain model's {theirs:.6f} nats: "
            "they do different work, and comparing their times means nothing."
        )


def flop(stack: Stack) -> float:
    """Floating-point operations of a plain model's update: products only, backward twice what forward takes.

    The first convolution counts once less, as pictures need no gradient. A stack computes less, because it encodes
    equal windows once; what it saves counts as done.
    """
    settings = stack.settings
    channels, hidden = sizes(settings.context_size)
    first = 9 * 9 * channels * 9 * stack.num_channels
    rest = 2 * 2 * 2 * channels * 9 * channels + 8 * channels * hidden + hidden * settings.context_size
    rest += (2 + 4 + settings.context_size) * settings.hidden_size + settings.hidden_size * 4
    return 2 * SAMPLES * (2 * first + 3 * rest)
