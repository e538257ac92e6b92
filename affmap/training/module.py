"""Training of a stack on the one-step negative log-likelihood, as a LightningModule (Section 3.3, Appendix A).

Each member is trained as if it were alone: the loss is the mean over the batch and the sum over members, and
gradients are clipped by norms per member and sub-model. So trials with other learning rates can be trained side by
side, too. Knows nothing of worlds and planners.

Errors are propagated back through a chunk of a sequence, 50 steps. A hidden state is passed to the next chunk without
its gradient, and is reset where new sequences begin. The paper resets it "every 7 batches": its 300 steps have 301
sensor readings, which probably make 7 chunks of 50, the last one short; here they make 6. Counting to 7 all the same
would carry the state of one sequence into another.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import lightning
import torch
from torch import Tensor, nn

from affmap.data.batches import Batch
from affmap.gaussian import Gaussian, nll
from affmap.model.stack import Stack
from affmap.model.transition import Carry
from affmap.training import loops
from affmap.training.composition import composition_gap, effect_prior, total_correlation
from affmap.training.settings import PerTrial, TrainingSettings


class Predicted(NamedTuple):
    """A batch and what M models say of it."""

    batch: Batch
    carry: Carry
    """Hidden state before the batch."""
    code: Tensor
    """`[M, B, T, C]`"""
    prediction: Gaussian
    """Of `[M, B, T, 2]`, u/step."""


class TrainingModule(lightning.LightningModule):
    """A stack in training; M are all of its members: with R trials those of the first trial, of the second, ...

    `training_nll` and `validation_nll`, `[num_epochs, M]` in nats, fill up as the epochs pass; they are buffers, so
    that a checkpoint holds them.
    """

    def __init__(self, stack: Stack, settings: TrainingSettings) -> None:
        """Train `stack` as `settings` say.

        Raises:
            ValueError: the members of `stack` cannot be those of the settings' trials.
        """
        super().__init__()
        self.automatic_optimization = False  # so that a step can be several updates
        if len(stack.seeds) % (settings.num_trials or 1):
            raise ValueError(f"a stack of {len(stack.seeds)} members cannot be {settings.num_trials} trials.")
        self.stack = stack
        self.settings = settings
        empty = next(stack.parameters()).new_full((settings.num_epochs, len(stack.seeds)), torch.nan)
        self.register_buffer("training_nll", empty)
        self.register_buffer("validation_nll", empty.clone())
        self.training_nll: Tensor
        self.validation_nll: Tensor
        self._carry: Carry = ()
        self._losses: list[Tensor] = []

    def loss(self, batch: Batch) -> Tensor:
        """Mean NLL of each member on a batch, `[M]` in nats."""
        return nll(self._predict(batch).prediction, batch.target).mean((1, 2))

    def evaluate(self, batch: Batch) -> Tensor:
        """The same as `loss` without a gradient, where possible in compiled loops."""
        return loops.losses(self.stack, batch) if loops.usable(self.stack) else self.loss(batch).detach()

    def _predict(self, batch: Batch) -> Predicted:
        """Predict a batch, and keep the hidden state for the next one."""
        carry = self.stack.transition.initial(batch.action.shape[1]) if batch.is_first else self._carry
        code = self.stack.encode(batch.views)
        last, prediction = self.stack.transition.unroll(carry, code, batch.delta, batch.action)
        self._carry = tuple(part.detach() for part in last)
        return Predicted(batch, carry, code, prediction)

    def update(self, batch: Batch, optimizer: torch.optim.Optimizer) -> Tensor:
        """Make an update of all members; return their losses before it, `[M]` in nats."""
        of_codes = self.stack.vision is not None and self.stack.settings.code.has_terms
        if loops.usable(self.stack) and not of_codes:
            compute: Any = partial(loops.update, self.stack, batch, optimizer, [norm for _, _, norm in self._parts()])
            losses: Any = optimizer.step(compute)  # finds no gradients, and does nothing more than count
            return losses
        predicted = self._predict(batch)
        losses = nll(predicted.prediction, batch.target).mean((1, 2))
        (losses + self._terms(predicted)).sum().backward()  # the gradient of each is what it would be alone
        self.configure_gradient_clipping(optimizer)
        optimizer.step()
        optimizer.zero_grad()
        return losses.detach()

    def _terms(self, predicted: Predicted) -> Tensor:
        """What is added to the loss of an update besides the likelihood, `[M]` in nats."""
        settings, (batch, carry, code, prediction) = self.stack.settings.code, predicted
        terms = code.new_zeros(len(code))
        auxiliary = self.stack.transition.auxiliary_loss()
        if auxiliary is not None:
            terms = terms + auxiliary
        if self.stack.vision is None:
            return terms
        if settings.paste and batch.pasted is not None:
            terms = terms + settings.paste * composition_gap(self.stack.encode(batch.pasted))
        if settings.penalty:
            terms = terms + settings.penalty * (code.abs().mean((1, 2, 3)) + total_correlation(code))
        if settings.effect_std:
            _, free = self.stack.transition.unroll(carry, torch.zeros_like(code), batch.delta, batch.action)
            terms = terms + effect_prior(prediction.mean - free.mean, settings.effect_std)
        return terms

    def on_train_epoch_start(self) -> None:
        """Set the learning rates of the epoch."""
        optimizer = self.optimizers()
        assert isinstance(optimizer, torch.optim.Optimizer)
        self.set_rates(optimizer, self.current_epoch)

    def set_rates(self, optimizer: torch.optim.Optimizer, epoch: int) -> None:
        """Set the learning rates of an epoch (from 0)."""
        factor = cooldown(epoch, self.settings.num_epochs, self.settings.cooldown)
        for group, (_, lr, _) in zip(optimizer.param_groups, self._parts(), strict=True):
            group["lr"] = factor * _common_rate(lr)

    def training_step(self, batches: Sequence[Batch], batch_index: int) -> None:
        """Make an update on each of the batches, in their order."""
        optimizer = self.optimizers()
        assert isinstance(optimizer, torch.optim.Optimizer)
        self._losses += [self.update(batch, optimizer) for batch in batches]

    def on_train_epoch_end(self) -> None:
        """Store the mean loss over the epoch's updates."""
        self.training_nll[self.current_epoch] = torch.stack(self._losses).mean(0)
        self._losses.clear()

    def on_validation_epoch_start(self) -> None:
        """Begin a new mean over the validation batches."""
        self._sum = torch.zeros_like(self.validation_nll[0])
        self._count = 0

    def validation_step(self, batches: Sequence[Batch], batch_index: int) -> None:
        """Add batches to the mean over all validation steps."""
        for batch in batches:
            count = batch.action[..., 0].numel()
            self._sum += count * self.evaluate(batch)
            self._count += count

    def on_validation_epoch_end(self) -> None:
        """Store the mean loss over all validation steps."""
        self.validation_nll[self.current_epoch] = self._sum / self._count

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam with a parameter group for each sub-model; the learning rate is 1 where trials have their own."""
        groups = [{"params": list(part.parameters()), "lr": _common_rate(lr)} for part, lr, _ in self._parts()]
        optimizer = torch.optim.Adam(groups, betas=(0.9, 0.999), eps=self.settings.adam_eps, fused=True)
        for part, lr, _ in self._parts():
            if isinstance(lr, tuple):
                scale_steps(optimizer, list(part.parameters()), self._per_member(lr))
        return optimizer

    def configure_gradient_clipping(self, optimizer: torch.optim.Optimizer, *_: Any, **__: Any) -> None:
        """Clip the norm of each member's gradient, for each sub-model."""
        for part, _lr, max_norm in self._parts():
            norms = self._per_member(max_norm) if isinstance(max_norm, tuple) else max_norm
            clip_per_member([p.grad for p in part.parameters() if p.grad is not None], norms)

    def _per_member(self, values: tuple[float, ...]) -> Tensor:
        """Values of the members, `[M]`, from those of the trials."""
        per_trial = next(self.stack.parameters()).new_tensor(values)
        return per_trial.repeat_interleave(len(self.stack.seeds) // len(values))

    def _parts(self) -> list[tuple[nn.Module, PerTrial, PerTrial]]:
        """List each sub-model with its learning rate and clipping norm."""
        settings, stack = self.settings, self.stack
        parts: list[tuple[nn.Module, PerTrial, PerTrial]] = [
            (stack.transition, settings.transition_lr, settings.transition_max_norm)
        ]
        if stack.vision is not None:
            parts.append((stack.vision, settings.vision_lr, settings.vision_max_norm))
        return parts


def cooldown(epoch: int, num_epochs: int, share: float) -> float:
    """Factor on the learning rates in an epoch (from 0): 1, and in the last `share` of the epochs falling to 0.1."""
    length = share * num_epochs
    passed = epoch + 1 - (num_epochs - length)
    return 0.1 ** (passed / length) if passed > 0 and length > 0 else 1.0


def _common_rate(lr: PerTrial) -> float:
    """Learning rate of the optimiser; 1 where trials have their own."""
    return 1.0 if isinstance(lr, tuple) else lr


def clip_per_member(gradients: Sequence[Tensor], max_norm: float | Tensor) -> None:
    """Scale gradients `[M, ...]` in place, so that each member's norm over all of them is at most `max_norm`.

    `max_norm` is a number, or one for each member, `[M]`.

    The same rule as `torch.nn.utils.clip_grad_norm_`, for each member by itself.
    """
    norm = torch.cat([gradient.flatten(1) for gradient in gradients], dim=1).norm(dim=1)  # [M]
    scale = (max_norm / (norm + 1e-6)).clamp_max(1.0)
    for gradient in gradients:
        gradient.mul_(scale.view(-1, *[1] * (gradient.ndim - 1)))


def scale_steps(optimizer: torch.optim.Adam, parameters: Sequence[Tensor], factors: Tensor) -> None:
    """Multiply the steps that `optimizer` makes with `parameters` `[M, ...]` by a factor for each member, `[M]`.

    The step of Adam is proportional to its learning rate and its moments do not depend on it, so the factors are the
    members' learning rates where the optimiser's is 1. Up to factors of 1 rounding is that of a single step.
    """
    before: list[Tensor] = []

    def remember(*_: Any) -> None:
        before[:] = [parameter.detach().clone() for parameter in parameters]

    def scale(*_: Any) -> None:
        for parameter, start in zip(parameters, before, strict=True):
            factor = factors.view(-1, *[1] * (parameter.ndim - 1))
            parameter.detach().copy_(start.lerp_(parameter.detach(), factor))

    optimizer.register_step_pre_hook(remember)
    optimizer.register_step_post_hook(scale)
