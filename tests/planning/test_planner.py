"""Common functions of planners: costs are checked, actions shifted."""

import numpy as np
import pytest
import torch

from affmap.planning.planner import evaluate, shift


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((3,), r"the objective returned shape \[3\]; it must be \[3, 4\]\."),
        ((4, 3), r"the objective returned shape \[4, 3\]; it must be \[3, 4\]\."),
        ((3, 4, 1), r"the objective returned shape \[3, 4, 1\]; it must be \[3, 4\]\."),
        ((3, 1), r"the objective returned shape \[3, 1\]; it must be \[3, 4\]\."),
        ((), r"the objective returned shape \[\]; it must be \[3, 4\]\."),
    ],
)
def test_an_objective_of_another_shape_is_named(shape: tuple[int, ...], message: str) -> None:
    """Golden message; broadcasting would hide it."""
    with pytest.raises(ValueError, match=message):
        evaluate(lambda actions: torch.zeros(shape), torch.zeros(3, 4, 2, 4))


def test_what_is_not_a_number_costs_infinitely_and_all_else_what_it_costs() -> None:
    """Number by number."""
    largest = torch.finfo(torch.float32).max
    costs = torch.tensor([[torch.nan, torch.inf, -torch.inf, 0.0], [-1.5, largest, -largest, 1e-40]])
    expected = torch.tensor([[torch.inf, torch.inf, -torch.inf, 0.0], [-1.5, largest, -largest, 1e-40]])
    assert torch.equal(evaluate(lambda actions: costs, torch.zeros(2, 4, 3, 4)), expected)


def test_the_objective_sees_the_actions_and_gradients_flow_through() -> None:
    """Closed form of a sum of squares."""
    actions = torch.rand(2, 3, 5, 4, generator=torch.Generator().manual_seed(0)).requires_grad_()
    (gradient,) = torch.autograd.grad(evaluate(lambda a: a.square().sum((-1, -2)), actions).sum(), actions)
    torch.testing.assert_close(gradient, 2 * actions.detach())


@pytest.mark.parametrize("shape", [(1, 4), (5, 4), (2, 5, 4), (2, 3, 5, 4), (2, 0, 5, 4), (2, 1, 4)])
def test_shift_moves_the_future_to_the_present_and_copies_the_last_action(shape: tuple[int, ...]) -> None:
    """Against a plain loop (Appendix B)."""
    actions = torch.rand(shape, generator=torch.Generator().manual_seed(0))
    expected = actions.numpy().copy()
    horizon = shape[-2]
    for index in np.ndindex(shape[:-2]):
        for step in range(horizon):
            expected[index][step] = actions.numpy()[index][min(step + 1, horizon - 1)]
    before = actions.clone()
    assert torch.equal(shift(actions), torch.from_numpy(expected))
    assert torch.equal(actions, before)
