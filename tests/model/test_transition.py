"""The transition model: the paper's number of parameters, and a plain multilayer perceptron in scaled units."""

import math

import pytest
import torch
from torch import Tensor

from affmap.model.transition import MLP

CONTEXT_SIZES = [0, 1, 3, 5, 8, 16, 32]


def transition(context_size: int, scale: float = 4.0, members: int = 3) -> MLP:
    generators = [torch.Generator().manual_seed(seed) for seed in range(members)]
    return MLP(generators, context_size, 32, scale)


def inputs(context_size: int, *shape: int) -> tuple[Tensor, Tensor, Tensor]:
    """Code, delta and action of three members."""
    generator = torch.Generator().manual_seed(0)
    code = torch.rand(3, *shape, context_size, generator=generator) * 2 - 1
    delta = torch.randn(3, *shape, 2, generator=generator) * 0.1
    return code, delta, torch.rand(3, *shape, 4, generator=generator)


@pytest.mark.parametrize("context_size", CONTEXT_SIZES)
def test_number_of_parameters(context_size: int) -> None:
    """Appendix A: 324 + 32 C."""
    parameters = list(transition(context_size).parameters())
    assert sum(parameter[0].numel() for parameter in parameters) == 324 + 32 * context_size
    assert all(len(parameter) == 3 for parameter in parameters)


@pytest.mark.parametrize("scale", [1.0, 4.0])
@pytest.mark.parametrize("context_size", [0, 1, 8])
def test_a_step_is_a_plain_perceptron(context_size: int, scale: float) -> None:
    """Appendix A written down for each member: tanh(W [4 delta, action, code]), linear means, exponential deviations,
    all in scaled units, and scaled back outside (CALIBRATION.md)."""
    model = transition(context_size, scale)
    code, delta, action = inputs(context_size, 6)
    carry, (mean, log_std) = model.step()(model.initial(), code, delta, action)
    assert carry == () and mean.shape == log_std.shape == (3, 6, 2)
    for member in range(3):
        scaled = torch.cat([delta[member] * scale, action[member], code[member]], dim=1)
        hidden = torch.tanh(scaled @ model.hidden_weight[member])
        outputs = hidden @ model.output_weight[member] + model.output_bias[member]
        torch.testing.assert_close(mean[member], outputs[:, :2] / scale)
        torch.testing.assert_close(log_std[member].exp(), outputs[:, 2:].exp() / scale)


def test_unroll_is_step_by_step() -> None:
    """Along T = 7 recorded steps; the recorded changes are the inputs, not the predicted ones."""
    model = transition(3)
    code, delta, action = inputs(3, 2, 7)
    _, together = model.unroll(model.initial(), code, delta, action)
    carry = model.initial()
    for step in range(7):
        carry, alone = model.step()(carry, code[:, :, step], delta[:, :, step], action[:, :, step])
        torch.testing.assert_close(together.mean[:, :, step], alone.mean)
        torch.testing.assert_close(together.log_std[:, :, step], alone.log_std)


def test_what_is_shared_by_all_members_is_the_same_as_a_copy_for_each() -> None:
    """Recorded motion, of leading axis 1, against its copies; bit for bit."""
    model = transition(3)
    code, delta, action = inputs(3, 2, 7)
    _, shared = model.unroll((), code, delta[:1], action[:1])
    _, copied = model.unroll((), code, delta[:1].expand(3, -1, -1, -1), action[:1].expand(3, -1, -1, -1))
    assert torch.equal(shared.mean, copied.mean) and torch.equal(shared.log_std, copied.log_std)


def test_standard_deviations_are_positive_and_finite() -> None:
    """Also at top speed, with all throttles open and saturated codes; initial ones are of the order 1 / scale."""
    model = transition(8)
    code, delta, action = torch.ones(3, 50, 8), torch.full((3, 50, 2), 0.23), torch.ones(3, 50, 4)
    _, (mean, log_std) = model.step()((), code, delta, action)
    assert log_std.exp().min() > 0 and torch.isfinite(log_std).all() and torch.isfinite(mean).all()
    # 32 hidden units in (-1, 1) and a bias, weights within 1 / sqrt(32): the scaled output is within 33 / sqrt(32).
    assert (log_std + math.log(4)).abs().max() <= 33 / math.sqrt(32)


def test_members_do_not_mix() -> None:
    """Gradient of one member's prediction: nothing reaches another's weights."""
    model = transition(3)
    _, (mean, log_std) = model.step()((), *inputs(3, 4))
    (mean[1].sum() + log_std[1].sum()).backward()
    for parameter in model.parameters():
        assert parameter.grad is not None
        assert parameter.grad[1].abs().max() > 0
        assert parameter.grad[[0, 2]].abs().max() == 0
