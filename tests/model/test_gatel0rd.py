"""Cells with few updates side by side: plain loops over steps and sequences, by the equations, member by member."""

import math

import pytest
import torch
from torch import Tensor

from affmap.model.gatel0rd import GateL0RD, share_open
from affmap.model.registry import GateL0RDSettings
from affmap.model.stack import ModelSettings, Stack

MEMBERS = 3


def model(context_size: int = 3, scale: float = 4.0, hidden_size: int = 32, noise: float = 0.1) -> GateL0RD:
    generators = [torch.Generator().manual_seed(seed) for seed in range(MEMBERS)]
    return GateL0RD(generators, context_size, hidden_size, scale, gate_penalty=0.01, gate_noise=noise)


def inputs(context_size: int, *shape: int) -> tuple[Tensor, Tensor, Tensor]:
    """Code, delta and action of three members."""
    generator = torch.Generator().manual_seed(0)
    code = torch.rand(MEMBERS, *shape, context_size, generator=generator) * 2 - 1
    delta = torch.randn(MEMBERS, *shape, 2, generator=generator) * 0.1
    return code, delta, torch.rand(MEMBERS, *shape, 4, generator=generator)


def started(cell: GateL0RD, num_sequences: int) -> tuple[Tensor]:
    """A carry in the midst of a sequence."""
    (zeros,) = cell.initial(num_sequences)
    return (torch.rand(zeros.shape, generator=torch.Generator().manual_seed(1)) * 2 - 1,)


def by_hand(cell: GateL0RD, member: int, x: Tensor, h: Tensor, scale: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """A step of one member in one sequence, by the equations: next state, gates, mean and log-deviation."""
    wx, wh, b = cell.input_weight[member], cell.hidden_weight[member], cell.bias[member]
    n = len(h)
    g, r, p, o = (slice(part * n, (part + 1) * n) for part in range(4))
    gate = torch.maximum(torch.zeros(n), torch.tanh(x @ wx[:, g] + h @ wh[:, g] + b[g]))
    new = torch.tanh(x @ wx[:, r] + h @ wh[:, r] + b[r])
    h = h + gate * (new - h)
    y = torch.tanh(x @ wx[:, p] + h @ wh[:, p] + b[p]) * torch.sigmoid(x @ wx[:, o] + h @ wh[:, o] + b[o])
    result = y @ cell.output.weight[member] + cell.output.bias[member]
    return h, gate, result[:2] / scale, result[2:] - math.log(scale)


@pytest.mark.parametrize("scale", [0.25, 4.0])
@pytest.mark.parametrize("hidden_size", [1, 32])
@pytest.mark.parametrize("context_size", [0, 1, 8])
def test_an_unrolled_stack_is_the_equations_of_each_member(context_size: int, hidden_size: int, scale: float) -> None:
    """Predictions, carry and gradients of all weights; without noise, as outside training."""
    cell = model(context_size, scale, hidden_size).eval()
    code, delta, action = inputs(context_size, 2, 5)
    carry = started(cell, 2)
    (hidden,), (mean, log_std) = cell.unroll(carry, code, delta, action)
    assert mean.shape == log_std.shape == (MEMBERS, 2, 5, 2) and hidden.shape == (MEMBERS, 2, hidden_size)
    weights = list(cell.parameters())
    own = torch.autograd.grad(mean.square().sum() + log_std.sin().sum() + hidden.sum(), weights)
    total = torch.zeros(())
    for member in range(MEMBERS):
        for sequence in range(2):
            h = carry[0][member, sequence]
            for t in range(5):
                at = member, sequence, t
                x = torch.cat([delta[at] * scale, action[at], code[at]])
                h, _, expected_mean, expected_log_std = by_hand(cell, member, x, h, scale)
                torch.testing.assert_close(mean[at], expected_mean)
                torch.testing.assert_close(log_std[at], expected_log_std)
                total = total + expected_mean.square().sum() + expected_log_std.sin().sum()
            torch.testing.assert_close(hidden[member, sequence], h)
            total = total + h.sum()
    for ours, theirs in zip(own, torch.autograd.grad(total, weights), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-4 * theirs.abs().max().item())


def test_unroll_is_step_by_step() -> None:
    """Along T = 7 recorded steps, also in two chunks."""
    cell = model().eval()
    code, delta, action = inputs(3, 2, 7)
    start = carry = started(cell, 2)
    (last,), together = cell.unroll(start, code, delta, action)
    chunk, first = cell.unroll(start, code[:, :, :4], delta[:, :, :4], action[:, :, :4])
    _, second = cell.unroll(chunk, code[:, :, 4:], delta[:, :, 4:], action[:, :, 4:])
    for whole, *halves in zip(together, first, second, strict=True):
        torch.testing.assert_close(whole, torch.cat(halves, dim=2))
    for step in range(7):
        carry, alone = cell.step()(carry, code[:, :, step], delta[:, :, step], action[:, :, step])
        torch.testing.assert_close(together.mean[:, :, step], alone.mean)
        torch.testing.assert_close(together.log_std[:, :, step], alone.log_std)
    torch.testing.assert_close(last, carry[0])


def test_a_unit_whose_gate_is_shut_stays_as_it_was() -> None:
    """Bit for bit, with biases of gates far below zero for the first half of the units; the others move."""
    cell = model(hidden_size=8).eval()
    with torch.no_grad():
        cell.bias[:, :4] = -50.0
        cell.bias[:, 4:8] = 50.0
    (start,) = started(cell, 2)
    (last,), _ = cell.unroll((start,), *inputs(3, 2, 7))
    assert torch.equal(last[..., :4], start[..., :4])
    assert ((last - start)[..., 4:].abs() > 1e-3).all()


def test_gates_are_noisy_in_training_only_and_each_time_anew() -> None:
    """Two unrolls in training differ, two outside do not; no noise if its deviation is 0."""
    cell, parts = model(), inputs(3, 2, 7)

    def unrolled(which: GateL0RD) -> Tensor:
        return which.unroll(which.initial(2), *parts)[1].mean.detach()

    assert not torch.equal(unrolled(cell), unrolled(cell))
    assert torch.equal(unrolled(cell.eval()), unrolled(cell))
    quiet = model(noise=0.0)
    torch.testing.assert_close(unrolled(quiet), unrolled(cell))


def test_a_training_that_resumes_has_the_noise_that_it_would_have_had() -> None:
    """The state after one unroll, loaded into a new model, gives the second unroll bit for bit."""
    cell, other, parts = model(), model(), inputs(3, 2, 7)
    cell.unroll(cell.initial(2), *parts)
    other.load_state_dict(cell.state_dict())
    second, again = (each.unroll(each.initial(2), *parts)[1] for each in (cell, other))
    assert torch.equal(second.mean, again.mean)


def test_the_auxiliary_loss_is_the_share_of_open_gates() -> None:
    """By hand, and its gradient is that of the mean of the gates: the straight-through estimator."""
    cell, parts = model(hidden_size=4, noise=0.0), inputs(3, 1, 2)
    cell.unroll(cell.initial(1), *parts)
    for member in range(MEMBERS):
        h, is_open = torch.zeros(4), []
        for t in range(2):
            code, delta, action = (part[member, 0, t] for part in parts)
            h, gate, *_ = by_hand(cell, member, torch.cat([4.0 * delta, action, code]), h, 4.0)
            is_open.append(gate > 0)
        torch.testing.assert_close(cell.auxiliary_loss()[member], 0.01 * torch.cat(is_open).float().mean())
    gates = torch.tensor([[[0.0, 0.5]], [[0.1, 0.0]]], requires_grad=True)  # T = 2, M = 1
    share = share_open(gates)
    assert share.item() == 0.5
    (gradient,) = torch.autograd.grad(share.sum(), gates)
    torch.testing.assert_close(gradient, torch.full_like(gates, 0.25))


def test_a_member_of_a_stack_is_the_member_alone() -> None:
    """Seeds 3 and 7 together against 7 alone: weights and seeds bit by bit, noisy predictions to rounding."""
    kind = GateL0RDSettings.load("model/transition", "gatel0rd")
    settings = ModelSettings.load("model", "default", context_size=3, transition=kind)
    together, alone = Stack(settings, 1, [3, 7]), Stack(settings, 1, [7])
    for name, parameter in alone.state_dict().items():
        assert torch.equal(together.state_dict()[name][1:], parameter), name
    parts = [part[:2] for part in inputs(3, 2, 7)]
    _, whole = together.transition.unroll(together.transition.initial(2), *parts)
    _, single = alone.transition.unroll(alone.transition.initial(2), *(part[1:] for part in parts))
    torch.testing.assert_close(whole.mean[1:], single.mean)
    torch.testing.assert_close(together.transition.auxiliary_loss()[1:], alone.transition.auxiliary_loss())
    assert torch.equal(
        together.select([1]).transition.state_dict()["noise_seed"], alone.state_dict()["transition.noise_seed"]
    )


def test_members_do_not_mix() -> None:
    """Gradient of one member's prediction and auxiliary loss: nothing reaches another's weights."""
    cell = model()
    _, (mean, log_std) = cell.unroll(started(cell, 2), *inputs(3, 2, 4))
    (mean[1].sum() + log_std[1].sum() + cell.auxiliary_loss()[1]).backward()
    for parameter in cell.parameters():
        assert parameter.grad is not None
        assert parameter.grad[1].abs().max() > 0
        assert parameter.grad[[0, 2]].abs().max() == 0
