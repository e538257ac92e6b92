"""Gradient-based planning against a plain NumPy version of Appendix B with the gradient worked out by hand."""

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from affmap.planning.gradient import GradientPlanner, GradientState
from affmap.planning.planner import Objective
from affmap.settings import ConfigError

quick = settings(max_examples=40, deadline=None, derandomize=True)
B, H = 6, 5


def planner(**changes: Any) -> GradientPlanner:
    return GradientPlanner.load("planner", "gradient", **{"horizon": H, **changes})


def quadratics(seed: int) -> tuple[Tensor, Tensor]:
    """Targets and weights `[B, H, 4]` of sums of squares, some so steep that descent climbs sooner or later."""
    random = np.random.default_rng(seed)
    targets = random.uniform(-0.3, 1.3, (B, H, 4))
    weights = np.exp(random.normal(1.5, 1.5, (B, H, 4)))
    return torch.tensor(targets).float(), torch.tensor(weights).float()


def quadratic(targets: Tensor, weights: Tensor) -> Objective:
    return lambda actions: (weights[:, None] * (actions - targets[:, None]).square()).sum((-1, -2))


def plain(
    method: GradientPlanner, actions: np.ndarray, target: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, float, int]:
    """Appendix B for one problem `[H, 4]`: actions, cost, and the number of updates that were kept; float64."""
    weights = [method.decay ** (method.horizon - tau) for tau in range(1, method.horizon + 1)]
    rates = [method.learning_rate * one / (sum(weights) / len(weights)) for one in weights]
    cost = float(np.sum(weight * (actions - target) ** 2))
    for update in range(method.num_iterations):
        changed = actions.copy()
        for tau in range(method.horizon):
            for throttle in range(4):
                gradient = 2 * weight[tau, throttle] * (actions[tau, throttle] - target[tau, throttle])
                changed[tau, throttle] = min(max(actions[tau, throttle] - rates[tau] * gradient, 0.0), 1.0)
        changed_cost = float(np.sum(weight * (changed - target) ** 2))
        if changed_cost > cost:
            return actions, cost, update
        actions, cost = changed, changed_cost
    return actions, cost, method.num_iterations


@pytest.mark.parametrize(("learning_rate", "num_iterations"), [(0.005, 50), (0.05, 12), (0.3, 12), (0.05, 1)])
def test_it_is_appendix_b(learning_rate: float, num_iterations: int) -> None:
    """Six quadratics; two steps, the second from the shifted actions of the first."""
    method = planner(learning_rate=learning_rate, num_iterations=num_iterations)
    state, expected_state, kept = method.initial(B), np.full((B, H, 4), 0.5), []
    for step in range(2):
        targets, weights = quadratics(step)
        plan, state = method.plan(quadratic(targets, weights), state, [])
        for b in range(B):
            target, weight = targets[b].double().numpy(), weights[b].double().numpy()
            actions, cost, updates = plain(method, expected_state[b], target, weight)
            np.testing.assert_allclose(plan.actions[b], actions, atol=2e-5)
            np.testing.assert_allclose(plan.cost[b], cost, rtol=1e-4)
            expected_state[b] = [*actions[1:], actions[-1]]
            np.testing.assert_allclose(state.actions[b], expected_state[b], atol=2e-5)
            kept.append(updates)
    if learning_rate == 0.05 and num_iterations == 12:  # the case that says most: some stop, at different cycles
        assert len(set(kept)) >= 4 and max(kept) == 12 and min(kept) < 6, kept


@pytest.mark.parametrize(("horizon", "decay"), [(1, 0.9), (5, 0.9), (20, 0.9), (20, 1.0), (7, 0.3)])
def test_learning_rates_fall_from_the_future_to_the_present(horizon: int, decay: float) -> None:
    """Appendix B: mean 0.005, each `decay` times the next; the nearest future moves least."""
    rates = planner(horizon=horizon, decay=decay).learning_rates()
    assert rates.shape == (horizon,)
    assert rates.mean().item() == pytest.approx(0.005, rel=1e-5)
    torch.testing.assert_close(rates[:-1], decay * rates[1:])
    assert (rates > 0).all() and rates[0] == rates.min()


def test_a_single_update_is_the_gradient_times_the_learning_rates() -> None:
    """Closed form: on a slope of 1 the first action moves least, all 0.005 on average, each within its throttle."""
    method = planner(num_iterations=1)
    plan, _ = method.plan(lambda actions: actions.sum((-1, -2)), method.initial(1), [])
    torch.testing.assert_close(0.5 - plan.actions[0], method.learning_rates()[:, None].expand(H, 4))
    assert 0.5 - plan.actions.mean().item() == pytest.approx(0.005, rel=1e-4)
    assert plan.actions[0, 0, 0] > plan.actions[0, -1, 0]


def test_it_finds_the_optimum_of_a_quadratic_inside_and_at_the_bounds() -> None:
    """Closed form: the target, or the bound next to it."""
    targets, _ = quadratics(0)
    method = planner(num_iterations=400, learning_rate=0.05)
    plan, _ = method.plan(quadratic(targets, torch.ones(B, H, 4)), method.initial(B), [])
    assert (targets < 0).any() and (targets > 1).any()
    torch.testing.assert_close(plan.actions, targets.clamp(0, 1), atol=1e-3, rtol=0)


@quick
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 10), st.floats(-30, 30), st.integers(1, 10))
def test_the_cost_never_rises_and_actions_never_leave_their_bounds(
    seed: int, learning_rate: float, frequency: float, num_iterations: int
) -> None:
    """Wild objectives, any learning rate: at most the initial cost, and the cost of the very plan returned."""

    def objective(actions: Tensor) -> Tensor:
        return (frequency * actions + actions.roll(1, -2)).sin().sum((-1, -2))

    start = torch.rand(B, H, 4, generator=torch.Generator().manual_seed(seed))
    method = planner(learning_rate=learning_rate, num_iterations=num_iterations)
    plan, state = method.plan(objective, GradientState(start), [])
    assert (plan.cost <= objective(start[:, None])[:, 0] + 1e-5).all()
    torch.testing.assert_close(plan.cost, objective(plan.actions[:, None])[:, 0], atol=1e-5, rtol=1e-5)
    for actions in (plan.actions, state.actions):
        assert ((actions >= 0) & (actions <= 1)).all()


def test_an_update_that_makes_it_worse_is_taken_back_and_is_the_last() -> None:
    """Against costs made up: the second update of problem 0 is worse, the third would be better."""
    seen: list[Tensor] = []
    costs = torch.tensor([[5.0, 4.0, 4.5, 1.0, 0.0], [5.0, 4.0, 4.0, 3.0, 2.0], [5.0, 6.0, 1.0, 1.0, 1.0]])

    def objective(actions: Tensor) -> Tensor:
        seen.append(actions.detach()[:, 0])
        slope = actions.sum((-1, -2))
        return slope - slope.detach() + costs[:, len(seen) - 1, None]

    method = planner(num_iterations=4)
    plan, _ = method.plan(objective, method.initial(3), [])
    assert len(seen) == 5
    assert torch.equal(plan.cost, torch.tensor([4.0, 2.0, 5.0]))  # an equal cost is no reason to stop
    assert torch.equal(plan.actions[0], seen[1][0])
    assert torch.equal(plan.actions[1], seen[4][1])
    assert torch.equal(plan.actions[2], seen[0][2])


def test_the_search_ends_when_all_problems_have_stopped() -> None:
    """Two evaluations, not 51; a problem that goes on keeps it going."""
    calls = []
    steep = torch.tensor([1.0, 1.0, 1.0])

    def objective(actions: Tensor) -> Tensor:
        calls.append(len(actions))
        return steep[:, None] * (actions - 0.4).square().sum((-1, -2))

    method = planner()
    for steepness, expected in ((1e4, 2), (1.0, 51)):
        steep[1] = steep[0] = 1e4
        steep[2] = steepness
        calls.clear()
        method.plan(objective, method.initial(3), [])
        assert len(calls) == expected


def test_problems_together_are_each_alone() -> None:
    """Bit for bit, also where they stop at different cycles; two steps."""
    method = planner(learning_rate=0.05, num_iterations=12)
    together, alone = method.initial(B), [method.initial(1) for _ in range(B)]
    for step in range(2):
        targets, weights = quadratics(step)
        plan, together = method.plan(quadratic(targets, weights), together, [])
        for b in range(B):
            objective = quadratic(targets[b : b + 1], weights[b : b + 1])
            one, alone[b] = method.plan(objective, alone[b], [])
            assert torch.equal(plan.actions[b], one.actions[0]) and torch.equal(plan.cost[b], one.cost[0])
            assert torch.equal(together.actions[b], alone[b].actions[0])


def test_the_next_step_starts_from_the_shifted_plan() -> None:
    """Appendix B: shifted, the last action copied; the objective is first asked about exactly that."""
    method = planner()
    targets, weights = quadratics(0)
    plan, state = method.plan(quadratic(targets, weights), method.initial(B), [])
    asked: list[Tensor] = []

    def objective(actions: Tensor) -> Tensor:
        asked.append(actions.detach().clone())
        return actions.square().sum((-1, -2))

    method.plan(objective, state, [])
    assert torch.equal(asked[0], plan.actions[:, [1, 2, 3, 4, 4]][:, None])


def test_a_state_is_not_changed_by_planning_from_it() -> None:
    method, objective = planner(), quadratic(*quadratics(0))
    _, state = method.plan(objective, method.initial(B), [])
    before = state.actions.clone()
    first, second = (method.plan(objective, state, [])[0].actions for _ in range(2))
    assert torch.equal(first, second) and torch.equal(state.actions, before)


@pytest.mark.parametrize("kind", ["cost", "gradient", "both", "later"])
def test_what_is_not_a_number_does_not_reach_actions_or_neighbours(kind: str) -> None:
    """The neighbours plan as if alone; the problem itself keeps its last good actions."""
    targets, weights = quadratics(0)
    weights = torch.ones_like(weights)
    plain_objective = quadratic(targets, weights)
    hit = torch.arange(B)[:, None] == 2

    def objective(actions: Tensor) -> Tensor:
        costs = plain_objective(actions)
        if kind == "cost":
            return costs + torch.where(hit, (actions - 2).log().sum((-1, -2)), 0.0)
        if kind in ("gradient", "both"):  # the root of zero: a finite value with an infinite slope, times zero
            costs = costs + torch.where(hit[..., None, None], actions * 0, 1.0).sqrt().sum((-1, -2))
            return torch.where(hit, torch.nan, 0.0) + costs if kind == "both" else costs
        moved = (actions - 0.5).abs().amax((-1, -2)) > 0.02
        return torch.where(hit & moved, torch.nan, costs)

    method = planner()
    plan, state = method.plan(objective, method.initial(B), [])
    for actions in (plan.actions, state.actions):
        assert ((actions >= 0) & (actions <= 1)).all()  # which NaN is not
    others = torch.arange(B) != 2
    alone, _ = method.plan(quadratic(targets[others], weights[others]), method.initial(B - 1), [])
    torch.testing.assert_close(plan.actions[others], alone.actions)
    if kind == "later":
        assert 0 < (plan.actions[2] - 0.5).abs().max() <= 0.02
        assert plan.cost[2] == plain_objective(plan.actions[:, None])[2, 0]
    else:
        assert torch.equal(plan.actions[2], torch.full((H, 4), 0.5))
        assert plan.cost[2].isinf() == (kind != "gradient")


def test_gradients_are_taken_whatever_the_surroundings_and_leave_none_behind() -> None:
    """Equal plans under `no_grad`; parameters of the model get no gradients."""
    targets, weights = quadratics(0)
    parameter = torch.ones((), requires_grad=True)
    method = planner()
    objective = quadratic(targets, weights)
    with torch.no_grad():
        quiet, _ = method.plan(lambda actions: parameter * objective(actions), method.initial(B), [])
    plan, state = method.plan(objective, method.initial(B), [])
    assert torch.equal(plan.actions, quiet.actions) and not torch.equal(plan.actions, method.initial(B).actions)
    assert parameter.grad is None
    assert not any(part.requires_grad for part in (*plan, *state, *quiet))


def test_the_configured_numbers_are_the_paper_s() -> None:
    """Appendix B; Section 4.2 for the horizon."""
    actual = GradientPlanner.load("planner", "gradient")
    assert (actual.horizon, actual.num_iterations, actual.learning_rate, actual.decay) == (20, 50, 0.005, 0.9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"horizon": 0}, "horizon = 0 is not allowed"),
        ({"num_iterations": 0}, "num_iterations = 0 is not allowed"),
        ({"initial_action": 1.1}, "initial_action = 1.1 is not allowed"),
        ({"initial_action": -0.1}, "initial_action = -0.1 is not allowed"),
        ({"learning_rate": 0.0}, "learning_rate = 0.0 is not allowed"),
        ({"learning_rate": float("inf")}, "learning_rate = inf is not allowed"),
        ({"decay": 0.0}, "decay = 0.0 is not allowed"),
        ({"decay": 1.1}, "decay = 1.1 is not allowed"),
        ({"kind": "cem"}, "kind = 'cem' is not allowed"),
        ({"momentum": 0.9}, "momentum = 0.9 is not a known key"),
    ],
)
def test_bad_settings_are_named(changes: dict[str, Any], message: str) -> None:
    """Golden parts of the message."""
    with pytest.raises(ConfigError, match=message):
        planner(**changes)
