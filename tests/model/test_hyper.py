"""The linear hypernetwork: a perceptron whose weight matrices are made for each code, written down for one member."""

import pytest
import torch
from torch import Tensor

from affmap.model.hyper import Hyper
from affmap.model.registry import HyperSettings
from affmap.model.stack import ModelSettings, Stack

SCALE = 4.0


def model(context_size: int = 3, rank: int = 2) -> Hyper:
    generators = [torch.Generator().manual_seed(seed) for seed in range(3)]
    return Hyper(generators, context_size, SCALE, units=5, rank=rank).requires_grad_(False)


def inputs(context_size: int = 3) -> tuple[Tensor, Tensor, Tensor]:
    """Code, delta and action of three members."""
    generator = torch.Generator().manual_seed(1)
    code = torch.rand(3, 6, context_size, generator=generator) * 2 - 1
    return code, torch.randn(3, 6, 2, generator=generator) * 0.1, torch.rand(3, 6, 4, generator=generator)


@pytest.mark.parametrize("context_size", [0, 1, 3])
def test_a_step_is_a_perceptron_with_weights_of_its_own_code(context_size: int) -> None:
    """W(c) = W + P diag(c Q) R for both layers, biases as further rows, in scaled units."""
    hyper, (code, delta, action) = model(context_size), inputs(context_size)
    _, (mean, log_std) = hyper.step()((), code, delta, action)
    for member in range(3):
        weights, inwards, codes, outwards = (
            [weight[member] for weight in part] for part in (hyper.weights, hyper.inputs, hyper.codes, hyper.outputs)
        )
        for problem in range(6):
            c = code[member, problem]
            first, second = (
                weights[n] + inwards[n] @ torch.diag(c @ codes[n]) @ outwards[n] for n in range(2)
            )  # fmt: skip
            x = torch.cat([SCALE * delta[member, problem], action[member, problem], torch.ones(1)])
            out = torch.cat([torch.tanh(x @ first), torch.ones(1)]) @ second
            torch.testing.assert_close(SCALE * mean[member, problem], out[:2])
            torch.testing.assert_close(SCALE * log_std[member, problem].exp(), out[2:].exp())


def test_the_configuration_makes_models_of_nearly_as_many_weights_as_the_papers() -> None:
    """580 weights of the perceptron at C = 8, within 20 %; codes are centered."""
    stack = Stack(ModelSettings(transition=HyperSettings()), 4, [0])
    num_weights = sum(parameter.numel() for parameter in stack.transition.parameters())
    assert num_weights == 540 and abs(num_weights - 580) < 0.2 * 580
    assert stack.vision is not None and stack.vision.encoder == "centered"
