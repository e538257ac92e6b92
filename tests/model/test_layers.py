"""Stacked layers: against PyTorch's own layer for each member, and each member against itself alone."""

import math

import pytest
import torch
from torch.nn.functional import linear

from affmap.model.layers import StackedLinear, tanh, uniform


def generators(*seeds: int) -> list[torch.Generator]:
    return [torch.Generator().manual_seed(seed) for seed in seeds]


@pytest.mark.parametrize("shape", [(7,), (2, 3), (1, 1, 4)])
def test_values_and_gradients_are_those_of_torch_for_each_member(shape: tuple[int, ...]) -> None:
    """`torch.nn.functional.linear` with member m's weights on member m's input."""
    layer = StackedLinear(generators(0, 1, 2), 5, 6)
    inputs = torch.randn(3, *shape, 5, generator=torch.Generator().manual_seed(9), requires_grad=True)
    outputs = layer(inputs)
    assert outputs.shape == (3, *shape, 6)
    slope = torch.randn(outputs.shape, generator=torch.Generator().manual_seed(10))
    (outputs * slope).sum().backward()
    for member in range(3):
        own = inputs.detach()[member].clone().requires_grad_()
        weight = layer.weight.detach()[member].T.clone().requires_grad_()
        offset = layer.bias.detach()[member].clone().requires_grad_()
        expected = linear(own, weight, offset)
        (expected * slope[member]).sum().backward()
        torch.testing.assert_close(outputs[member], expected)
        assert inputs.grad is not None and layer.weight.grad is not None and weight.grad is not None
        torch.testing.assert_close(inputs.grad[member], own.grad)
        torch.testing.assert_close(layer.weight.grad[member], weight.grad.T)
        assert layer.bias.grad is not None
        torch.testing.assert_close(layer.bias.grad[member], offset.grad)


def test_a_parameter_is_uniform_between_its_bounds() -> None:
    """Statistics of 40,000 draws a member: +-1 / sqrt(inputs), mean 0, variance bound^2 / 3; members differ."""
    parameter = uniform(generators(3, 4), (100, 400), 25)
    bound = 1 / math.sqrt(25)
    for member in parameter.detach():
        assert -bound <= member.min() < -0.999 * bound and 0.999 * bound < member.max() <= bound
        assert abs(member.mean().item()) < 0.01 * bound
        assert member.var().item() == pytest.approx(bound**2 / 3, rel=0.02)
        assert torch.histc(member, 4, -bound, bound).min() > 9_700  # of 10,000 expected, standard deviation 87
    assert abs(torch.corrcoef(parameter.detach().flatten(1))[0, 1].item()) < 0.02


def test_layers_begin_within_the_bounds_of_torch() -> None:
    """PyTorch's own layers draw weights and biases from +-1 / sqrt(number of inputs)."""
    layer = StackedLinear(generators(*range(50)), 16, 8)
    for parameter in (layer.weight, layer.bias):
        assert parameter.shape[0] == 50 and parameter.requires_grad
        assert parameter.abs().max().item() == pytest.approx(0.25, rel=0.02) and parameter.abs().max() <= 0.25


def test_a_member_does_not_depend_on_its_neighbours() -> None:
    """Same alone: two layers drawn one after the other from the member's own generator."""
    streams, alone = generators(3, 7), generators(7)
    for _ in range(2):
        together, single = StackedLinear(streams, 4, 5), StackedLinear(alone, 4, 5)
        assert together.bias is not None and single.bias is not None
        torch.testing.assert_close(together.weight[1], single.weight[0], rtol=0, atol=0)
        torch.testing.assert_close(together.bias[1], single.bias[0], rtol=0, atol=0)


def test_tanh_is_torch_s_to_rounding() -> None:
    """torch's own in float64, values and gradients, as far as it saturates; float32 rounds once more on the way."""
    inputs = torch.linspace(-12, 12, 4001, requires_grad=True)
    found = tanh(inputs)
    (slope,) = torch.autograd.grad(found.sum(), inputs)
    precise = inputs.detach().double().requires_grad_()
    expected = precise.tanh()
    (expected_slope,) = torch.autograd.grad(expected.sum(), precise)
    torch.testing.assert_close(found.double(), expected, atol=2.5e-7, rtol=0)
    torch.testing.assert_close(slope.double(), expected_slope, atol=5e-7, rtol=0)
