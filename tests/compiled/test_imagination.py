"""Compiled imagination against PyTorch's in float64: rollouts, expected free energy, and autograd through both.

Positions stand all over the arena, on its borders and outside; models have weights as drawn, or larger.
"""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from affmap import compiled as loops
from affmap.control.imagination import CompiledImagination, compiled_imagination
from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import ModelSettings, Stack
from affmap.model.transition import MLP
from affmap.planning.objective import expected_free_energy

WORLD = Layout.load("layout", "original").map
SEEDS, AGENTS = (4, 5, 6), 2
B = len(SEEDS) * AGENTS
SPACING = 0.1

CONTEXT_SIZES = (0, 1, 3, 5, 8, 16, 32)


def make_stack(context_size: int, hidden_size: int = 32, scale: float = 1.0) -> Stack:
    settings = ModelSettings.load("model", "default", context_size=context_size, hidden_size=hidden_size)
    made = Stack(settings, WORLD.num_channels, SEEDS).requires_grad_(False)
    for weight in made.transition.parameters():
        weight.mul_(scale)
    return made


def make_map(stack: Stack, num_worlds: int = 1, differentiable: bool = False) -> AffordanceMap:
    """Codes that are waves over the arena; random ones would make paths chaotic."""
    columns, rows = (round(length / SPACING) + 1 for length in WORLD.size)
    leading = len(SEEDS) if num_worlds == 1 else num_worlds
    generator = torch.Generator().manual_seed(1)
    phase, along_x, along_y = 3 * torch.randn(3, leading, 1, 1, stack.context_size, generator=generator)
    x, y = torch.linspace(0, 1, columns)[None, None, :, None], torch.linspace(0, 1, rows)[None, :, None, None]
    return AffordanceMap((phase + along_x * x + along_y * y).sin(), [WORLD] * num_worlds, differentiable)


def situation(seed: int = 0) -> Situation:
    """Starts inside, on borders, in corners and outside of the arena."""
    generator = torch.Generator().manual_seed(seed)
    size = torch.tensor(WORLD.size)
    position = torch.rand(B, 2, generator=generator) * size
    position[1] = torch.tensor([0.0, 1.0])
    position[2] = size
    position[3] = torch.tensor([-0.4, 2.3])
    return Situation(position, 0.1 * torch.randn(B, 2, generator=generator), ())


def desired() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(7)
    return torch.rand(B, 2, generator=generator) * torch.tensor(WORLD.size), torch.tensor([0.1, 0.01] * (B // 2))


def random_actions(num_candidates: int, horizon: int) -> Tensor:
    return torch.rand(B, num_candidates, horizon, 4, generator=torch.Generator().manual_seed(9))


def doubled(stack: Stack, lookup: AffordanceMap) -> tuple[Stack, AffordanceMap]:
    wide = stack.select(range(len(SEEDS))).double().requires_grad_(False)
    return wide, AffordanceMap(lookup.codes.double(), lookup.worlds, lookup.differentiable)


def reference(stack: Stack, lookup: AffordanceMap, start: Situation, actions: Tensor, beta: float) -> Tensor:
    """Costs in float64, by PyTorch."""
    wide, codes = doubled(stack, lookup)
    goal, std = (part.double() for part in desired())
    begin = Situation(start.position.double(), start.delta.double(), ())
    path = rollout(wide.transition, codes, begin, actions.double())
    return expected_free_energy(path, goal[:, None], std[:, None], beta).total


def compiled(stack: Stack, lookup: AffordanceMap | ExactLookup) -> CompiledImagination:
    imagination = compiled_imagination(stack, lookup)
    assert imagination is not None
    return imagination


def assert_near(costs: Tensor, expected: Tensor, tolerance: float = 1e-5) -> None:
    """Relative to the typical cost: a cost is a difference of terms, and may be near 0."""
    scale = expected.abs().clamp_min(expected.abs().median())
    assert ((costs - expected).abs() <= tolerance * scale).all(), ((costs - expected).abs() / scale).max()


@pytest.mark.parametrize("context_size", CONTEXT_SIZES)
@pytest.mark.parametrize("num_candidates", [1, 2, 8, 11])
def test_costs(context_size: int, num_candidates: int) -> None:
    stack = make_stack(context_size)
    lookup, start, actions = make_map(stack), situation(), random_actions(num_candidates, 20)
    objective = compiled(stack, lookup).objective(start, *desired(), beta=1.0)
    assert_near(objective(actions), reference(stack, lookup, start, actions, 1.0))


@pytest.mark.parametrize("beta", [0.0, 0.5, 10.0])
@pytest.mark.parametrize("horizon", [1, 2, 3, 7])
@pytest.mark.parametrize("hidden_size", [1, 8, 20])
def test_costs_of_other_settings(beta: float, horizon: int, hidden_size: int) -> None:
    stack = make_stack(3, hidden_size)
    lookup, start, actions = make_map(stack), situation(), random_actions(9, horizon)
    objective = compiled(stack, lookup).objective(start, *desired(), beta)
    assert_near(objective(actions), reference(stack, lookup, start, actions, beta))


@pytest.mark.parametrize("num_worlds", [len(SEEDS), B])
def test_costs_in_many_worlds(num_worlds: int) -> None:
    """A world a member, or one for each of its agents."""
    stack = make_stack(5)
    lookup, start, actions = make_map(stack, num_worlds), situation(), random_actions(9, 5)
    objective = compiled(stack, lookup).objective(start, *desired(), beta=1.0)
    assert_near(objective(actions), reference(stack, lookup, start, actions, 1.0))


def test_costs_of_wild_models() -> None:
    """Weights thirty times as large: hidden units at their limits, steps of several u, variances from 1e-20 to 1e20."""
    stack = make_stack(3, scale=30.0)
    lookup, start, actions = make_map(stack), situation(), random_actions(9, 3)
    objective = compiled(stack, lookup).objective(start, *desired(), beta=1.0)
    expected = reference(stack, lookup, start, actions, 1.0)
    assert expected.max() > 1e10
    path = rollout(stack.transition, lookup, start, actions)
    goal, std = desired()
    single = expected_free_energy(path, goal[:, None], std[:, None], 1.0).total
    # Inputs of hundreds round to 1e-5, and small differences grow: PyTorch's float32 is the measure.
    assert ((objective(actions) - expected).abs() / expected.abs()).max() <= 3 * (single / expected - 1).abs().max()


def test_variances_that_no_float_holds() -> None:
    """Costs are then infinite or no number, as PyTorch's, and planners take both for infinite."""
    stack = make_stack(3)
    stack.transition.output_bias[0, 2:] = 300.0
    lookup, start, actions = make_map(stack), situation(), random_actions(9, 3)
    costs = compiled(stack, lookup).objective(start, *desired(), beta=1.0)(actions)
    expected = reference(stack, lookup, start, actions, 1.0)
    assert not costs[:AGENTS].isfinite().any()
    assert_near(costs[AGENTS:], expected[AGENTS:])


def test_weights_that_are_no_numbers_cost_no_number_and_their_neighbours_nothing() -> None:
    stack = make_stack(3)
    lookup, start, actions = make_map(stack), situation(), random_actions(9, 3)
    expected = reference(stack, lookup, start, actions, 1.0)
    stack.transition.hidden_weight[1, 0, 0] = torch.nan
    objective = compiled(stack, lookup).objective(start, *desired(), beta=1.0)
    costs = objective(actions)
    assert costs[AGENTS : 2 * AGENTS].isnan().all()
    others = [0, 1, 4, 5]
    assert_near(costs[others], expected[others])


def test_weights_may_change() -> None:
    """A plan is made with the weights of its time."""
    stack = make_stack(3)
    lookup, start, actions = make_map(stack), situation(), random_actions(9, 3)
    imagination = compiled(stack, lookup)
    before = imagination.objective(start, *desired(), 1.0)(actions)
    stack.load_state_dict({name: weight * 1.5 for name, weight in stack.state_dict().items()})
    after = imagination.objective(start, *desired(), 1.0)(actions)
    assert not torch.allclose(before, after)
    assert_near(after, reference(stack, lookup, start, actions, 1.0))


@pytest.mark.parametrize("context_size", [0, 3, 8])
@pytest.mark.parametrize("num_candidates", [1, 11])
def test_positions(context_size: int, num_candidates: int) -> None:
    stack = make_stack(context_size)
    lookup, start, actions = make_map(stack), situation(), random_actions(num_candidates, 6)
    path = compiled(stack, lookup).positions(start, actions)
    wide, codes = doubled(stack, lookup)
    expected = rollout(wide.transition, codes, Situation(*(part.double() for part in start[:2]), ()), actions.double())
    for mine, its in zip(path, expected, strict=True):
        assert mine.shape == (B, num_candidates, 6, 2)
        torch.testing.assert_close(mine.double(), its, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("context_size", CONTEXT_SIZES)
@pytest.mark.parametrize("differentiable", [False, True])
@pytest.mark.parametrize("num_candidates", [1, 3])
def test_gradients(context_size: int, differentiable: bool, num_candidates: int) -> None:
    stack = make_stack(context_size)
    lookup, start, actions = (
        make_map(stack, differentiable=differentiable),
        situation(),
        random_actions(num_candidates, 9),
    )
    mine, its = actions.clone().requires_grad_(), actions.double().requires_grad_()
    cost = compiled(stack, lookup).objective(start, *desired(), 0.7)(mine)
    expected = reference(stack, lookup, start, its, 0.7)
    weight = torch.rand(B, num_candidates, generator=torch.Generator().manual_seed(3))
    (gradient,) = torch.autograd.grad((weight * cost).sum(), mine)
    (its_gradient,) = torch.autograd.grad((weight * expected).sum(), its)
    assert_near(cost.detach(), expected.detach())
    scale = its_gradient.abs().amax((2, 3), keepdim=True)
    assert ((gradient - its_gradient).abs() <= 2e-5 * scale).all()


def test_gradients_in_many_worlds() -> None:
    stack = make_stack(8)
    lookup, start, actions = make_map(stack, B, differentiable=True), situation(), random_actions(2, 4)
    mine, its = actions.clone().requires_grad_(), actions.double().requires_grad_()
    (gradient,) = torch.autograd.grad(compiled(stack, lookup).objective(start, *desired(), 1.0)(mine).sum(), mine)
    (expected,) = torch.autograd.grad(reference(stack, lookup, start, its, 1.0).sum(), its)
    torch.testing.assert_close(gradient.double(), expected, rtol=1e-4, atol=1e-5 * expected.abs().max().item())


def test_a_cost_is_the_same_with_and_without_gradient() -> None:
    """Gradient descent compares the two, when it decides whether its last update has helped."""
    stack = make_stack(8)
    objective = compiled(stack, make_map(stack)).objective(situation(), *desired(), 1.0)
    actions = random_actions(1, 20)
    assert torch.equal(objective(actions), objective(actions.clone().requires_grad_()).detach())


def test_problems_left_out_cost_no_number_and_have_no_gradient() -> None:
    stack = make_stack(8)
    objective = compiled(stack, make_map(stack)).objective(situation(), *desired(), 1.0)
    actions = random_actions(1, 5)
    whole = actions.clone().requires_grad_()
    (expected,) = torch.autograd.grad(objective(whole).sum(), whole)
    some = actions.clone()
    some[[1, 4]] = torch.nan
    some.requires_grad_()
    costs = objective(some)
    (gradient,) = torch.autograd.grad(costs.sum(), some)
    assert costs[[1, 4]].isnan().all() and (gradient[[1, 4]] == 0).all()
    rest = [0, 2, 3, 5]
    assert torch.equal(gradient[rest], expected[rest])


def test_problems_alone() -> None:
    """B problems together cost what each costs alone, to the last bit."""
    stack = make_stack(8)
    lookup, start, actions = make_map(stack), situation(), random_actions(9, 5)
    goal, std = desired()
    together = compiled(stack, lookup).objective(start, goal, std, 1.0)(actions)
    for b in range(B):
        own, here = b // AGENTS, slice(b, b + 1)
        alone = compiled(stack.select([own]), AffordanceMap(lookup.codes[own : own + 1], [WORLD]))
        begin = Situation(start.position[here], start.delta[here], ())
        assert torch.equal(alone.objective(begin, goal[here], std[here], 1.0)(actions[here])[0], together[b])


class _Own(MLP):
    """Somebody's model, which may compute anything."""


@pytest.mark.parametrize("context_size", [1, 8, 32])
@pytest.mark.parametrize("num_worlds", [1, B])
def test_gradients_with_exact_look_ups(context_size: int, num_worlds: int) -> None:
    """By autograd on PyTorch alone, in float32 because pixels depend on the last bit of a position.

    Worlds have different numbers of circles.
    """
    stack = make_stack(context_size)
    for weight in stack.parameters():
        weight.mul_(2)  # codes of untrained models hardly differ
    worlds = [replace(WORLD, circles=WORLD.circles[: 1 + number]) for number in range(num_worlds)]
    lookup, start, actions = ExactLookup(stack, worlds), situation(), random_actions(1, 6)
    goal, std = desired()
    mine, its = actions.clone().requires_grad_(), actions.clone().requires_grad_()
    cost = compiled(stack, lookup).objective(start, goal, std, 0.7)(mine)
    with loops.switched(False):
        path = rollout(stack.transition, lookup, start, its)
        expected = expected_free_energy(path, goal[:, None], std[:, None], 0.7).total
    (gradient,) = torch.autograd.grad(cost.sum(), mine)
    (its_gradient,) = torch.autograd.grad(expected.sum(), its)
    assert_near(cost.detach(), expected.detach(), 5e-5)
    scale = its_gradient.abs().amax((2, 3), keepdim=True)
    assert ((gradient - its_gradient).abs() <= 1e-3 * scale).all()


def test_many_candidates_with_exact_look_ups_are_left_to_pytorch() -> None:
    """Costs and positions are those of the reference, and there is a gradient."""
    stack = make_stack(8)
    lookup, start, actions = ExactLookup(stack, [WORLD]), situation(), random_actions(5, 4).requires_grad_()
    goal, std = desired()
    imagination = compiled(stack, lookup)
    cost = imagination.objective(start, goal, std, 1.0)(actions)
    path = rollout(stack.transition, lookup, start, actions)
    assert torch.equal(cost, expected_free_energy(path, goal[:, None], std[:, None], 1.0).total)
    assert torch.equal(imagination.positions(start, actions).mean, path.mean)
    (gradient,) = torch.autograd.grad(cost.sum(), actions)
    assert gradient.abs().max() > 0


@pytest.mark.parametrize("kind", ["another model", "a hidden state", "no vision model", "float64"])
def test_other_models_look_ups_and_numbers_are_left_to_pytorch(kind: str) -> None:
    stack = make_stack(3)
    lookup: AffordanceMap | ExactLookup = make_map(stack)
    if kind == "another model":
        stack = Stack(stack.settings, WORLD.num_channels, SEEDS, _Own)
    elif kind == "a hidden state":
        gru = ModelSettings.load("model", "default", context_size=3, transition={"kind": "gru"})
        stack = Stack(gru, WORLD.num_channels, SEEDS).requires_grad_(False)
    elif kind == "no vision model":
        stack = make_stack(0)
        lookup = ExactLookup(stack, [WORLD])
    else:
        stack.double()
    assert compiled_imagination(stack, lookup) is None
