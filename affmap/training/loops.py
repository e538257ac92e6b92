"""Losses and updates of a stack by compiled loops, with PyTorch's weights and moments.

`TrainingModule` in PyTorch is their reference.
"""

import functools
import math
from collections.abc import Iterable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from affmap import compiled
from affmap.compiled.layout import NUM_TAPS, Layout, Parameters, layout
from affmap.compiled.samples import Samples, samples
from affmap.data.batches import Batch
from affmap.model.stack import Stack, readable
from affmap.model.transition import MLP
from affmap.model.vision import sizes
from affmap.training.settings import PerTrial


def usable(stack: Stack) -> bool:
    """Whether compiled loops are enabled and support a stack: the paper's models, on a CPU."""
    plain = stack.vision is None or stack.vision.encoder == "plain"
    return type(stack.transition) is MLP and plain and readable(stack.parameters()) and compiled.enabled()


def losses(stack: Stack, batch: Batch) -> Tensor:
    """Mean NLL of each member on a batch, `[M]` in nats, without a gradient."""
    from affmap.compiled import training  # needs numba

    parameters = _parameters(stack)
    result = parameters[0].new_empty(len(stack.seeds))
    training.losses(_arrays(parameters), _layout(stack), _samples(stack, batch), result.numpy())
    return result + _constant(stack)


def update(stack: Stack, batch: Batch, optimizer: torch.optim.Optimizer, max_norms: Sequence[PerTrial]) -> Tensor:
    """Make an update of all members by clipping and Adam; return their losses before it, `[M]` in nats.

    Args:
        stack: the members.
        batch: the samples.
        optimizer: Adam with a parameter group for each sub-model; its state is as after updates in PyTorch.
        max_norms: clipping norms of the sub-models.
    """
    from affmap.compiled import adam, training  # needs numba

    parameters = _parameters(stack)
    states = [optimizer.state[parameter] for parameter in parameters]
    for parameter, state in zip(parameters, states, strict=True):
        if not state:
            state["step"] = parameter.new_zeros(())
            state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(parameter), torch.zeros_like(parameter)
    transition, vision = optimizer.param_groups[0], optimizer.param_groups[-1]
    norms = [_per_member(max_norm, len(stack.seeds)) for max_norm in max_norms]
    step = int(states[0]["step"]) + 1
    for state in states:
        state["step"].fill_(step)
    rule = adam.Adam(
        step=step,
        mean_decay=transition["betas"][0],
        square_decay=transition["betas"][1],
        eps=transition["eps"],
        rates=(float(transition["lr"]), float(vision["lr"])),
        max_norms=(norms[0], norms[-1]),
    )
    means, squares = (_arrays(state[moment] for state in states) for moment in ("exp_avg", "exp_avg_sq"))
    result = parameters[0].new_empty(len(stack.seeds))
    own, places, data = _arrays(parameters), _layout(stack), _samples(stack, batch)
    training.update(own, means, squares, places, data, rule, result.numpy())
    return result + _constant(stack)


def _parameters(stack: Stack) -> Sequence[Tensor]:
    """Parameters of a stack in the order of `Parameters`."""
    transition, vision = stack.transition, stack.vision
    assert isinstance(transition, MLP)
    parameters = [transition.hidden_weight, transition.output_weight, transition.output_bias]
    if vision is not None:
        parameters += [vision.conv1_weight, vision.conv1_bias, vision.conv2_weight, vision.conv2_bias]
        parameters += [vision.linear1.weight, vision.linear1.bias, vision.linear2.weight, vision.linear2.bias]
    return parameters


def _arrays(tensors: Iterable[Tensor]) -> Parameters:
    """Parameters as `[M, numbers]`, in the same memory; those that a model lacks are empty."""
    own = [tensor.detach().numpy() for tensor in tensors]
    own = [array.reshape(len(array), -1, copy=False) for array in own]
    return Parameters(*own, *[np.empty((len(own[0]), 0), np.float32)] * (len(Parameters._fields) - len(own)))


def _per_member(value: PerTrial, num_members: int) -> NDArray[np.float32]:
    """Values of the members, `[M]`, from a common one or from those of the trials."""
    values = np.array(value, np.float32, ndmin=1)
    return values.repeat(num_members // len(values))


def _layout(stack: Stack) -> Layout:
    channels, hidden = sizes(stack.context_size)
    return _layouts(NUM_TAPS * stack.num_channels, channels, hidden, stack.context_size, stack.settings.hidden_size)


_layouts = functools.cache(layout)


def _constant(stack: Stack) -> float:
    """Constant to add to the losses of scaled changes, nats."""
    return math.log(2 * math.pi) - 2 * math.log(stack.settings.delta_scale)


def _samples(stack: Stack, batch: Batch) -> Samples:
    ids, window_ids, patch_ids, patches = (part.numpy() for part in batch.views)
    if stack.vision is None:
        ids, window_ids = np.zeros_like(ids), window_ids[:1]
    changes, throttles, targets = (part.flatten(0, -2).numpy() for part in (batch.delta, batch.action, batch.target))
    scale = np.float32(stack.settings.delta_scale)
    return samples(ids.ravel(), window_ids, patch_ids, patches, scale * changes, throttles, scale * targets)
