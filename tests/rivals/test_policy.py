"""Policies: the network against PyTorch's own layers, and the controller against the network called by hand."""

import numpy as np
import pytest
import torch
from torch import Tensor

from affmap.control.controller import Observation
from affmap.rivals.policy import CHANGE, Network, Policy, pixels_of, state_of
from affmap.rivals.settings import Activation


def network(members: int, channels: int = 2, **options: object) -> Network:
    generators = [torch.Generator().manual_seed(seed) for seed in range(members)]
    return Network(generators, channels, (7, 5), **options)  # type: ignore[arg-type]


def observation(number: int, channels: int = 2) -> Observation:
    rng = np.random.default_rng(0)
    parts = {key: rng.normal(size=(number, 2)) for key in ("position", "delta", "goal")}
    views = rng.integers(2, size=(number, channels, 11, 11))
    rows = [{key: part[row] for key, part in parts.items()} | {"view": views[row]} for row in range(number)]
    return Observation.of(rows)


def by_hand(model: Network, member: int, state: Tensor, pixels: Tensor, squash: bool, activation: Activation) -> Tensor:
    """One member, as PyTorch's functions have it."""
    if model.view is not None:
        pixels = torch.tanh(torch.nn.functional.linear(pixels, model.view.weight[member].T, model.view.bias[member]))
    values = torch.cat([state, pixels], dim=1)
    for number, layer in enumerate(model.layers):
        values = torch.nn.functional.linear(values, layer.weight[member].T, layer.bias[member])
        if number < 2:
            values = getattr(torch, activation)(values)
    return torch.tanh(values) if squash else values


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("squash", [True, False])
@pytest.mark.parametrize("view_units", [0, 3])
def test_a_policy_acts_as_its_network_says(view_units: int, squash: bool, activation: Activation) -> None:
    """PyTorch's own layers, member by member; B vehicles are member-major, and actions are openings in [0, 1]."""
    model, seen = network(3, view_units=view_units, squash=squash, activation=activation), observation(6)
    with torch.no_grad():
        for each in model.parameters():
            each.mul_(3)  # so that some outputs are beyond what can be executed
    decision, _ = Policy(model).act(seen, None, [])
    state = torch.cat([seen.position, CHANGE * seen.delta, seen.goal - seen.position], dim=1)
    pixels = seen.view.float().flatten(1)
    for member in range(3):
        own = slice(2 * member, 2 * member + 2)
        expected = ((by_hand(model, member, state[own], pixels[own], squash, activation) + 1) / 2).clamp(0, 1)
        torch.testing.assert_close(decision.action[own], expected)
    assert (decision.action == 0).any() or squash
    assert decision.path.mean.isnan().all() and decision.delta.log_std.isnan().all()


def test_a_member_is_the_same_alone() -> None:
    """Weights and outputs of a stack of three, and of each made by itself."""
    seen = observation(4)
    state, pixels = state_of(seen), pixels_of(seen)
    whole = network(3, view_units=3)(state.expand(3, -1, -1), pixels.expand(3, -1, -1))
    for seed in range(3):
        alone = Network([torch.Generator().manual_seed(seed)], 2, (7, 5), 3)
        torch.testing.assert_close(alone(state[None], pixels[None])[0], whole[seed])


def test_parameters_are_counted_for_one_member() -> None:
    """By hand: a layer that sees 2 x 121 pixels, then 9, 7, 5 and 4 units."""
    expected = 242 * 3 + 3 + 9 * 7 + 7 + 7 * 5 + 5 + 5 * 4 + 4
    assert network(3, view_units=3).num_parameters == expected
    assert repr(Policy(network(3, view_units=3))) == f"Policy({expected} parameters)"
