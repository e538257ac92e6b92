"""Imagined paths against a plain loop over problems, candidates, steps and numbers."""

import math
from typing import Any

import pytest
import torch
from torch import Tensor

from affmap.env.layout import Layout
from affmap.gaussian import Gaussian
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import ModelSettings, Stack
from affmap.model.transition import MLP, Carry

WORLD = Layout.load("layout", "original").map
SEEDS, AGENTS, N, H = (4, 5), 3, 2, 4
B = len(SEEDS) * AGENTS


def stack(*seeds: int, context_size: int) -> Stack:
    made = Stack(ModelSettings.load("model", "default", context_size=context_size), WORLD.num_channels, seeds)
    return made.requires_grad_(False)


def situation() -> tuple[Tensor, Tensor, Tensor]:
    """Positions and deltas `[B, 2]`, actions `[B, N, H, 4]`."""
    generator = torch.Generator().manual_seed(0)
    position = torch.rand(B, 2, generator=generator) * torch.tensor(WORLD.size)
    delta = 0.1 * torch.randn(B, 2, generator=generator)
    return position, delta, torch.rand(B, N, H, 4, generator=generator)


@pytest.mark.parametrize("context_size", [0, 3])
def test_it_is_a_plain_loop_and_problems_belong_to_members_in_order(context_size: int) -> None:
    """Section 3.4, one candidate at a time with problem b's own member b // (B / M), made alone from its seed.

    The mean is the next input, codes come from the mean position; variances add up and become deviations again.
    """
    whole = stack(*SEEDS, context_size=context_size)
    position, delta, actions = situation()
    start = Situation(position, delta, whole.transition.initial())
    found = rollout(whole.transition, ExactLookup(whole, [WORLD]), start, actions)
    assert found.mean.shape == found.log_std.shape == (B, N, H, 2)
    for b in range(B):
        one = stack(SEEDS[b // AGENTS], context_size=context_size)
        lookup = ExactLookup(one, [WORLD])
        for n in range(N):
            here, change, variance = position[b].tolist(), delta[b], [0.0, 0.0]
            for step in range(H):
                code = lookup(torch.tensor(here)[None, None])
                _, prediction = one.transition.step()((), code, change[None, None], actions[b, n, step][None, None])
                change = prediction.mean[0, 0]
                for axis in range(2):
                    here[axis] += change[axis].item()
                    variance[axis] += math.exp(prediction.log_std[0, 0, axis].item()) ** 2
                    assert found.mean[b, n, step, axis].item() == pytest.approx(here[axis], abs=1e-5)
                    assert found.log_std[b, n, step, axis].exp().item() == pytest.approx(
                        variance[axis] ** 0.5, rel=1e-4
                    )
    assert (found.mean[0] - found.mean[AGENTS]).abs().max() > 1e-2


def test_the_code_is_looked_up_where_the_vehicle_is_expected_to_be() -> None:
    """Golden order: first at the position itself, then at each mean but the last."""
    whole = stack(*SEEDS, context_size=3)
    position, delta, actions = situation()
    asked: list[Tensor] = []
    exact = ExactLookup(whole, [WORLD])

    def lookup(positions: Tensor) -> Tensor:
        asked.append(positions)
        return exact(positions)

    found = rollout(whole.transition, lookup, Situation(position, delta, ()), actions)
    assert len(asked) == H
    torch.testing.assert_close(asked[0], position.repeat_interleave(N, 0).view(2, AGENTS * N, 2))
    for step in range(1, H):
        torch.testing.assert_close(asked[step], found.mean[:, :, step - 1].view(2, AGENTS * N, 2))


def test_problems_together_are_each_alone() -> None:
    """With an affordance map; each problem with a stack of its own member."""
    whole = stack(*SEEDS, context_size=3)
    position, delta, actions = situation()
    together = rollout(
        whole.transition, AffordanceMap.paint(whole, [WORLD], 0.1), Situation(position, delta, ()), actions
    )
    for b in range(B):
        one = stack(SEEDS[b // AGENTS], context_size=3)
        lookup, mine = AffordanceMap.paint(one, [WORLD], 0.1), slice(b, b + 1)
        alone = rollout(one.transition, lookup, Situation(position[mine], delta[mine], ()), actions[mine])
        for whole_part, part in zip(together, alone, strict=True):
            torch.testing.assert_close(whole_part[mine], part, atol=1e-5, rtol=1e-5)


def test_the_carry_goes_from_step_to_step() -> None:
    """A model that adds up its throttles and moves by the sum, with a start of its own for each problem; by hand."""

    class Adding(MLP):
        def step(self) -> Any:
            def step(carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
                total = carry[0] + action[..., :2]
                return (total,), Gaussian(total, torch.zeros_like(total))

            return step

    adding = Adding([torch.Generator().manual_seed(seed) for seed in SEEDS], 0, 32, 4.0).requires_grad_(False)
    position, delta, actions = situation()
    carry = torch.randn(len(SEEDS), AGENTS, 2, generator=torch.Generator().manual_seed(3))
    lookup = ExactLookup(stack(*SEEDS, context_size=0), [WORLD])
    found = rollout(adding, lookup, Situation(position, delta, (carry,)), actions)
    moves = carry.view(B, 1, 1, 2) + actions[..., :2].cumsum(2)
    torch.testing.assert_close(found.mean, position.view(B, 1, 1, 2) + moves.cumsum(2))


def test_any_memory_layout_of_actions_will_do() -> None:
    """Against a contiguous copy."""
    whole = stack(*SEEDS, context_size=3)
    position, delta, actions = situation()
    lookup, start = AffordanceMap.paint(whole, [WORLD], 0.5), Situation(position, delta, ())
    strange = actions.transpose(1, 2).contiguous().transpose(1, 2)
    same = actions[:, :1].expand(-1, 3, -1, -1)
    for layout in (strange, same):
        found, expected = (rollout(whole.transition, lookup, start, each) for each in (layout, layout.contiguous()))
        assert torch.equal(found.mean, expected.mean)


@pytest.mark.parametrize("context_size", [0, 3])
def test_along_a_given_path_deviations_are_those_of_each_step_alone(context_size: int) -> None:
    """A plain loop with each problem's own member: places and changes are those of the path, means are the path."""
    whole = stack(*SEEDS, context_size=context_size)
    position, delta, actions = situation()
    path = position[:, None, None] + 0.1 * torch.randn(B, N, H, 2, generator=torch.Generator().manual_seed(7)).cumsum(2)
    lookup, start = ExactLookup(whole, [WORLD]), Situation(position, delta, ())
    found = rollout(whole.transition, lookup, start, actions, path)
    torch.testing.assert_close(found.mean, path, atol=1e-6, rtol=0)
    for b in range(B):
        one = stack(SEEDS[b // AGENTS], context_size=context_size)
        codes = ExactLookup(one, [WORLD])
        for n in range(N):
            here, change, variance = position[b], delta[b], torch.zeros(2)
            for step in range(H):
                code = codes(here[None, None])
                _, prediction = one.transition.step()((), code, change[None, None], actions[b, n, step][None, None])
                variance = variance + (2 * prediction.log_std[0, 0]).exp()
                torch.testing.assert_close(found.log_std[b, n, step], 0.5 * variance.log(), atol=1e-4, rtol=0)
                change, here = path[b, n, step] - here, path[b, n, step]
    free = rollout(whole.transition, lookup, start, actions)
    assert (found.log_std - free.log_std).abs().max() > 1e-3


def test_along_its_own_path_it_imagines_the_same() -> None:
    """The predicted means given as the path change nothing."""
    whole = stack(*SEEDS, context_size=3)
    position, delta, actions = situation()
    lookup, start = AffordanceMap.paint(whole, [WORLD], 0.1), Situation(position, delta, ())
    free = rollout(whole.transition, lookup, start, actions)
    along = rollout(whole.transition, lookup, start, actions, free.mean)
    torch.testing.assert_close(along.mean, free.mean, atol=1e-6, rtol=0)
    torch.testing.assert_close(along.log_std, free.log_std, atol=1e-5, rtol=0)


def test_deviations_never_shrink_along_a_path() -> None:
    """Variances are positive and add up: H steps of one deviation give sqrt(H) times as much (closed form)."""
    whole = stack(4, context_size=0)
    torch.nn.init.zeros_(whole.transition.output_weight)
    start = Situation(torch.zeros(1, 2), torch.zeros(1, 2), ())
    found = rollout(whole.transition, ExactLookup(whole, [WORLD]), start, torch.rand(1, 1, 9, 4))
    bias = whole.transition.output_bias[0] / torch.tensor([4.0, 4.0, 1.0, 1.0])
    steps = torch.arange(1, 10.0)[:, None]
    torch.testing.assert_close(found.mean[0, 0], steps * bias[:2])
    torch.testing.assert_close(found.log_std[0, 0], bias[2:] - math.log(4) + 0.5 * steps.log())


@pytest.mark.parametrize("differentiable", [False, True])
def test_gradients_reach_the_actions_as_finite_differences_say(differentiable: bool) -> None:
    """Float64; without gradients through the look-up, against a look-up frozen along the path."""
    whole = stack(*SEEDS, context_size=3).double()
    position, delta, actions = (part.double() for part in situation())
    codes = torch.randn(2, 21, 31, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    painted = AffordanceMap(codes, [WORLD], differentiable)
    weights = torch.randn(2, B, N, H, 2, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    seen: list[Tensor] = []

    def remember(positions: Tensor) -> Tensor:
        seen.append(painted(positions).detach())
        return painted(positions)

    def value(candidates: Tensor, frozen: bool = False) -> Tensor:
        replay = iter(seen)
        lookup = (lambda positions: next(replay)) if frozen else painted
        path: Gaussian = rollout(whole.transition, lookup, Situation(position, delta, ()), candidates)
        return (weights * torch.stack(tuple(path))).sum()

    rollout(whole.transition, remember, Situation(position, delta, ()), actions)
    variable = actions.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(variable), variable)
    for index in ((0, 0, 0, 0), (1, 1, 0, 3), (3, 0, 1, 2), (5, 1, 3, 1), (4, 0, 0, 2)):
        offset = torch.zeros_like(actions)
        offset[index] = 1e-6
        frozen = not differentiable
        expected = (value(actions + offset, frozen) - value(actions - offset, frozen)) / 2e-6
        torch.testing.assert_close(gradient[index], expected, atol=1e-5, rtol=1e-4)
    if not differentiable:  # the two kinds of gradient are not the same, or this would show nothing
        through = AffordanceMap(codes, [WORLD], True)
        path = rollout(whole.transition, through, Situation(position, delta, ()), variable)
        (other,) = torch.autograd.grad((weights * torch.stack(tuple(path))).sum(), variable)
        assert (other - gradient).abs().max() > 1e-2


def test_a_code_that_is_given_is_that_of_the_first_step() -> None:
    """Against a look-up that gives it in the first step, and what is looked up afterwards."""
    whole = stack(*SEEDS, context_size=3)
    position, delta, actions = situation()
    start, exact = Situation(position, delta, ()), ExactLookup(whole, [WORLD])
    given = torch.rand(len(SEEDS), AGENTS, 3, generator=torch.Generator().manual_seed(1))
    calls = []

    def lookup(positions: Tensor) -> Tensor:
        calls.append(positions)
        first = given.repeat_interleave(N, dim=1)
        return first if len(calls) == 1 else exact(positions)

    expected = rollout(whole.transition, lookup, start, actions)  # type: ignore[arg-type]
    found = rollout(whole.transition, exact, start, actions, code=given)
    torch.testing.assert_close(found.mean, expected.mean)
    torch.testing.assert_close(found.log_std, expected.log_std)
    assert (found.mean - rollout(whole.transition, exact, start, actions).mean).abs().max() > 1e-3
