"""Gated recurrent units side by side: `torch.nn.GRU`, member by member, and step after step."""

import math

import pytest
import torch
from torch import Tensor

from affmap.model.gru import GRU
from affmap.model.registry import GRUSettings
from affmap.model.stack import ModelSettings, Stack

MEMBERS = 3


def model(context_size: int = 3, scale: float = 4.0, hidden_size: int = 32, members: int = MEMBERS) -> GRU:
    generators = [torch.Generator().manual_seed(seed) for seed in range(members)]
    return GRU(generators, context_size, hidden_size, scale)


def inputs(context_size: int, *shape: int) -> tuple[Tensor, Tensor, Tensor]:
    """Code, delta and action of three members."""
    generator = torch.Generator().manual_seed(0)
    code = torch.rand(MEMBERS, *shape, context_size, generator=generator) * 2 - 1
    delta = torch.randn(MEMBERS, *shape, 2, generator=generator) * 0.1
    return code, delta, torch.rand(MEMBERS, *shape, 4, generator=generator)


def started(gru: GRU, num_sequences: int) -> tuple[Tensor]:
    """A carry in the midst of a sequence."""
    (zeros,) = gru.initial(num_sequences)
    return (torch.rand(zeros.shape, generator=torch.Generator().manual_seed(1)) * 2 - 1,)


def reference(gru: GRU, member: int) -> torch.nn.GRU:
    """PyTorch's own, with the weights of a member."""
    num_inputs, num_gates = gru.input_weight.shape[1:]
    own = torch.nn.GRU(num_inputs, num_gates // 3, batch_first=True)
    weights = [gru.input_weight.mT, gru.hidden_weight.mT, gru.input_bias, gru.hidden_bias]
    for parameter, weight in zip(own.parameters(), weights, strict=True):
        parameter.data = weight[member].detach().clone()
    return own


@pytest.mark.parametrize("scale", [1.0, 4.0])
@pytest.mark.parametrize("hidden_size", [1, 32])
@pytest.mark.parametrize("context_size", [0, 1, 8])
def test_an_unrolled_stack_is_pytorchs_own_gru_of_each_member(
    context_size: int, hidden_size: int, scale: float
) -> None:
    """Predictions, carry, and the gradients of all weights; changes of position in scaled units, as Appendix A."""
    gru = model(context_size, scale, hidden_size)
    code, delta, action = inputs(context_size, 5, 7)
    carry = started(gru, 5)
    (hidden,), (mean, log_std) = gru.unroll(carry, code, delta, action)
    assert mean.shape == log_std.shape == (MEMBERS, 5, 7, 2) and hidden.shape == (MEMBERS, 5, hidden_size)
    (mean.square().sum() + log_std.sin().sum() + hidden.sum()).backward()
    for member in range(MEMBERS):
        own = reference(gru, member)
        scaled = torch.cat([delta[member] * scale, action[member], code[member]], dim=-1)
        states, last = own(scaled, carry[0][member, None])
        outputs = states @ gru.output.weight[member].detach() + gru.output.bias[member].detach()
        expected_mean, expected_log_std = outputs[..., :2] / scale, outputs[..., 2:] - math.log(scale)
        torch.testing.assert_close(mean[member], expected_mean)
        torch.testing.assert_close(log_std[member], expected_log_std)
        torch.testing.assert_close(hidden[member], last[0])
        (expected_mean.square().sum() + expected_log_std.sin().sum() + last.sum()).backward()
        mine = [gru.input_weight, gru.hidden_weight, gru.input_bias, gru.hidden_bias]
        for ours, theirs in zip(mine, own.parameters(), strict=True):
            assert ours.grad is not None and theirs.grad is not None
            gradient = ours.grad[member].mT if ours.ndim == 3 else ours.grad[member]
            torch.testing.assert_close(gradient, theirs.grad, rtol=1e-4, atol=1e-4 * theirs.grad.abs().max().item())


def test_unroll_is_step_by_step() -> None:
    """Along T = 7 recorded steps, also in two chunks; the recorded changes are the inputs, not the predicted ones."""
    gru = model()
    code, delta, action = inputs(3, 2, 7)
    start = carry = started(gru, 2)
    (last,), together = gru.unroll(start, code, delta, action)
    chunk, first = gru.unroll(start, code[:, :, :4], delta[:, :, :4], action[:, :, :4])
    _, second = gru.unroll(chunk, code[:, :, 4:], delta[:, :, 4:], action[:, :, 4:])
    for whole, *halves in zip(together, first, second, strict=True):
        torch.testing.assert_close(whole, torch.cat(halves, dim=2))
    for step in range(7):
        carry, alone = gru.step()(carry, code[:, :, step], delta[:, :, step], action[:, :, step])
        torch.testing.assert_close(together.mean[:, :, step], alone.mean)
        torch.testing.assert_close(together.log_std[:, :, step], alone.log_std)
    torch.testing.assert_close(last, carry[0])


@pytest.mark.parametrize("context_size", [0, 8])
def test_initial_weights_are_as_pytorchs(context_size: int) -> None:
    """As many as in `torch.nn.GRU` and `Linear`; uniform in +-1 / sqrt(hidden_size), of which nearly all is used."""
    gru = model(context_size)
    own = [*torch.nn.GRU(6 + context_size, 32).parameters(), *torch.nn.Linear(32, 4).parameters()]
    parameters = list(gru.parameters())
    assert sum(parameter[0].numel() for parameter in parameters) == sum(parameter.numel() for parameter in own)
    assert all(len(parameter) == MEMBERS for parameter in parameters)
    for parameter in parameters:
        assert 0.8 / math.sqrt(32) < parameter.abs().max() <= 1 / math.sqrt(32)
        assert parameter.detach().mean().abs() < 0.1 / math.sqrt(32) * (1 + 10 * (parameter.numel() < 100))


def test_a_member_of_a_stack_is_the_member_alone() -> None:
    """Seeds 3 and 7 together against 7 alone: weights bit by bit, predictions to rounding."""
    settings = ModelSettings.load("model", "default", context_size=3, transition=GRUSettings(kind="gru"))
    together, alone = Stack(settings, 1, [3, 7]), Stack(settings, 1, [7])
    assert isinstance(together.transition, GRU)
    for name, parameter in alone.state_dict().items():
        assert torch.equal(together.state_dict()[name][1:], parameter), name
    parts = [part[:2] for part in inputs(3, 2, 7)]
    _, whole = together.transition.unroll(together.transition.initial(2), *parts)
    _, single = alone.transition.unroll(alone.transition.initial(2), *(part[1:] for part in parts))
    torch.testing.assert_close(whole.mean[1:], single.mean)
    torch.testing.assert_close(whole.log_std[1:], single.log_std)
    (chosen,) = [together.select([1]).transition]
    assert isinstance(chosen, GRU) and torch.equal(
        chosen.hidden_weight, alone.transition.get_parameter("hidden_weight")
    )


def test_what_is_shared_by_all_members_is_the_same_as_a_copy_for_each() -> None:
    """Recorded motion, of leading axis 1, against its copies; bit for bit."""
    gru = model()
    code, delta, action = inputs(3, 2, 7)
    _, shared = gru.unroll(gru.initial(2), code, delta[:1], action[:1])
    _, copied = gru.unroll(gru.initial(2), code, delta[:1].expand(3, -1, -1, -1), action[:1].expand(3, -1, -1, -1))
    assert torch.equal(shared.mean, copied.mean) and torch.equal(shared.log_std, copied.log_std)


def test_members_do_not_mix() -> None:
    """Gradient of one member's prediction: nothing reaches another's weights."""
    gru = model()
    _, (mean, log_std) = gru.unroll(started(gru, 2), *inputs(3, 2, 4))
    (mean[1].sum() + log_std[1].sum()).backward()
    for parameter in gru.parameters():
        assert parameter.grad is not None
        assert parameter.grad[1].abs().max() > 0
        assert parameter.grad[[0, 2]].abs().max() == 0
