"""The cross-entropy method against a plain NumPy version of Appendix B, scipy's truncated normal, and itself alone."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from torch import Tensor

from affmap.planning.cem import CEMPlanner, CEMState, truncated_normal
from affmap.planning.planner import Objective
from affmap.settings import ConfigError

pytestmark = pytest.mark.usefixtures("loops")

quick = settings(max_examples=40, deadline=None, derandomize=True)
H = 3


def planner(**changes: Any) -> CEMPlanner:
    return CEMPlanner.load("planner", "cem", **{"horizon": H, **changes})


def generators(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in seeds]


def uniform(generator: np.random.Generator, *shape: int) -> torch.Tensor:
    return torch.from_numpy(generator.random(shape, np.float32))


class Recorder:
    """An objective that remembers what it was asked and what it said."""

    def __init__(self, objective: Objective) -> None:
        self._objective = objective
        self.candidates: list[Tensor] = []
        self.costs: list[Tensor] = []

    def __call__(self, actions: Tensor) -> Tensor:
        self.candidates.append(actions.clone())
        self.costs.append(self._objective(actions))
        return self.costs[-1]


def distance_to(targets: Tensor) -> Objective:
    """Squared distance to targets `[B, H, 4]`, without products of matrices, whose rounding depends on the batch."""
    return lambda actions: (actions - targets[:, None]).square().sum((-1, -2))


def nowhere(actions: Tensor) -> Tensor:
    return torch.full(actions.shape[:2], torch.nan)


# --- against Appendix B in plain NumPy -------------------------------------------------------------------------------


class PlainCEM:
    """One problem, one candidate at a time, in float64."""

    def __init__(self, settings: CEMPlanner) -> None:
        self.settings = settings
        self.mean = np.full((settings.horizon, 4), settings.initial_mean)
        self.kept: list[np.ndarray] = []

    def plan(self, cost: Callable[[np.ndarray], float], uniforms: list[np.ndarray]) -> tuple[np.ndarray, float]:
        settings = self.settings
        variance = np.full_like(self.mean, settings.initial_variance)  # "we reset the variances"
        for uniform in uniforms:
            std = np.sqrt(variance)
            low, high = -self.mean / std, (1 - self.mean) / std
            drawn = [stats.truncnorm.ppf(u, low, high, self.mean, std) for u in uniform]
            candidates = self.kept + drawn
            costs = [cost(candidate) for candidate in candidates]
            order = sorted(range(len(costs)), key=lambda index: costs[index])[: settings.num_elites]
            elites = [candidates[index] for index in order]
            usable = [candidates[index] for index in order if costs[index] < np.inf]
            if usable:
                rest, momentum = 1 - settings.momentum, settings.momentum
                self.mean = momentum * self.mean + rest * np.mean(usable, axis=0)
                variance = momentum * variance + rest * np.var(usable, axis=0)
            best, best_cost = elites[0], costs[order[0]]
            self.kept = elites[: settings.num_kept]
        self.mean = self._next(self.mean)
        self.kept = [self._next(elite) for elite in self.kept]
        return best, best_cost

    @staticmethod
    def _next(actions: np.ndarray) -> np.ndarray:
        return np.array([*actions[1:], actions[-1]])


@pytest.mark.parametrize(
    ("changes", "holes"),
    [
        ({}, -np.inf),
        ({}, 0.75),  # most candidates cost NaN, so that often fewer than five elites are usable
        ({"num_kept": 0}, -np.inf),
        ({"num_kept": 5, "momentum": 0.0}, 0.4),
        ({"horizon": 1, "num_candidates": 7, "num_elites": 7, "momentum": 0.6, "initial_variance": 0.02}, -np.inf),
        ({"num_elites": 1, "num_kept": 1, "num_iterations": 1, "initial_mean": 0.0}, 0.4),
    ],
)
def test_it_is_appendix_b(changes: dict[str, Any], holes: float) -> None:
    """Three problems with coupled quadratic objectives that change from step to step; four steps with warm starts."""
    method = planner(**{"num_candidates": 20, **changes})
    size = 4 * method.horizon
    random = np.random.default_rng(3)
    matrices, targets = random.normal(size=(3, size, size)), random.normal(size=(4, 3, size))
    plain = [PlainCEM(method) for _ in range(3)]
    state = method.initial(3)
    for step in range(4):

        def objective(actions: Tensor, step: int = step) -> Tensor:
            flat = actions.flatten(-2)
            matrix, target = torch.tensor(matrices).float(), torch.tensor(targets[step]).float()
            costs = (flat @ matrix - target[:, None]).square().sum(-1)
            return torch.where(flat[..., 0] < holes, torch.nan, costs)

        plan, state = method.plan(objective, state, generators(*range(10 * step, 10 * step + 3)))
        for b in range(3):

            def cost(actions: np.ndarray, step: int = step, b: int = b) -> float:
                if actions.flat[0] < holes:
                    return np.inf
                return float(np.sum((actions.ravel() @ matrices[b] - targets[step, b]) ** 2))

            (generator,) = generators(10 * step + b)
            shape = (method.num_candidates, method.horizon, 4)
            uniforms = [generator.random(shape, np.float32).astype(float) for _ in range(method.num_iterations)]
            actions, best_cost = plain[b].plan(cost, uniforms)
            np.testing.assert_allclose(plan.actions[b], actions, atol=1e-4)
            np.testing.assert_allclose(plan.cost[b], best_cost, rtol=1e-4)
            np.testing.assert_allclose(state.mean[b], plain[b].mean, atol=1e-4)
            kept = np.reshape(plain[b].kept, (method.num_kept, method.horizon, 4))
            np.testing.assert_allclose(state.elites[b], kept, atol=1e-4)


# --- truncated normal ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-9), (torch.float32, 2e-5)])
def test_truncated_normal_has_scipy_s_quantiles(dtype: torch.dtype, tolerance: float) -> None:
    """scipy.stats.truncnorm, at and between the bounds."""
    mean, std, uniform = torch.meshgrid(
        torch.tensor([0.0, 1e-3, 0.1, 0.5, 0.8, 1.0], dtype=dtype),
        torch.tensor([1e-3, 0.02, 0.3, 0.5**0.5, 5.0], dtype=dtype),
        torch.linspace(0.001, 0.999, 41, dtype=dtype),
        indexing="ij",
    )
    m, s, u = (part.double().numpy() for part in (mean, std, uniform))
    expected = stats.truncnorm.ppf(u, -m / s, (1 - m) / s, m, s)
    np.testing.assert_allclose(truncated_normal(mean, std, uniform), expected, atol=tolerance)


@pytest.mark.parametrize(("mean", "std"), [(0.5, 0.5**0.5), (0.05, 0.2), (1.0, 0.4), (0.3, 3.0)])
def test_truncated_normal_is_drawing_again(mean: float, std: float) -> None:
    """Rejection sampling as in Appendix B; Kolmogorov and Smirnov cannot tell 20,000 of each apart (fixed seeds)."""
    random = np.random.default_rng(0)
    again = random.normal(mean, std, 400_000)
    again = again[(again >= 0) & (again <= 1)][:20_000]
    uniform = torch.rand(20_000, generator=torch.Generator().manual_seed(0))
    actual = truncated_normal(torch.tensor(mean), torch.tensor(std), uniform)
    assert len(again) == 20_000 and stats.ks_2samp(again, actual.numpy()).pvalue > 0.01
    assert len(actual.unique()) > 19_900  # nothing piles up at the bounds


def test_rounding_leaves_no_truncated_normal_outside() -> None:
    """[0, 1], at the smallest and the largest number that `torch.rand` returns, for ten thousand distributions."""
    generator = torch.Generator().manual_seed(0)
    mean, width = torch.rand(10_000, 1, generator=generator), torch.rand(10_000, 1, generator=generator)
    actual = truncated_normal(mean, 10 ** (4 * width - 3), torch.tensor([0.0, 2.0**-24, 1 - 2.0**-24]))
    assert ((actual >= 0) & (actual <= 1)).all()


@pytest.mark.parametrize("mean", [0.0, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("std", [0.0, 1e-30, 1e-6])
def test_a_narrow_truncated_normal_is_its_mean(mean: float, std: float) -> None:
    """Also for the smallest and the largest number that `torch.rand` returns: nothing is ever ten deviations away."""
    uniform = torch.tensor([0.0, 2.0**-24, 0.5, 1 - 2.0**-24])
    actual = truncated_normal(torch.tensor(mean), torch.tensor(std), uniform)
    np.testing.assert_allclose(actual, mean, atol=10 * std + 1e-15)


# --- what it finds ---------------------------------------------------------------------------------------------------


def test_it_finds_the_optimum_of_a_quadratic_inside_and_at_the_bounds() -> None:
    """Closed form: the target, or the bound next to it."""
    targets = torch.rand(4, H, 4, generator=torch.Generator().manual_seed(0)) * 2 - 0.5  # a half lies outside
    method = planner(num_iterations=20, num_candidates=500, num_elites=25)
    plan, _ = method.plan(distance_to(targets), method.initial(4), generators(0, 1, 2, 3))
    optimum = targets.clamp(0, 1)
    assert (targets < 0).any() and (targets > 1).any()
    torch.testing.assert_close(plan.actions, optimum, atol=0.02, rtol=0)
    assert torch.equal(plan.cost, distance_to(targets)(plan.actions[:, None])[:, 0])


def test_warm_starts_follow_what_moves() -> None:
    """Twenty problems whose targets come a step nearer at each step: better, on average, than starting cold."""
    path = torch.rand(20, 12, 4, generator=torch.Generator().manual_seed(5))
    method, cold, warm = planner(), [], []
    state, streams = method.initial(20), generators(*range(20))
    for step in range(8):
        objective = distance_to(path[:, step : step + H])
        cold.append(method.plan(objective, method.initial(20), generators(*range(20)))[0].cost.mean())
        plan, state = method.plan(objective, state, streams)
        warm.append(plan.cost.mean())
    assert all(w < 0.8 * c for w, c in zip(warm[2:], cold[2:], strict=True)), (warm, cold)


def test_problems_together_are_each_alone() -> None:
    """Bit for bit, over three steps: each its own generator and its own state."""
    targets = torch.rand(3, 4, H, 4, generator=torch.Generator().manual_seed(1))
    method = planner()
    together, streams = method.initial(4), generators(5, 6, 7, 8)
    alone, own = [method.initial(1) for _ in range(4)], [generators(seed) for seed in (5, 6, 7, 8)]
    for step in range(3):
        plan, together = method.plan(distance_to(targets[step]), together, streams)
        for b in range(4):
            one, alone[b] = method.plan(distance_to(targets[step, b : b + 1]), alone[b], own[b])
            assert torch.equal(plan.actions[b], one.actions[0]) and torch.equal(plan.cost[b], one.cost[0])
            assert torch.equal(together.mean[b], alone[b].mean[0])
            assert torch.equal(together.elites[b], alone[b].elites[0])
    assert not torch.equal(plan.actions[0], plan.actions[1])


def test_same_seeds_same_plan_and_no_others() -> None:
    """Bit for bit, and untouched by torch's global generator."""
    method, targets = planner(), torch.rand(2, H, 4, generator=torch.Generator().manual_seed(2))
    plans = []
    for seed in (1, 1, 2):
        torch.rand(3)
        plans.append(method.plan(distance_to(targets), method.initial(2), generators(seed, seed))[0].actions)
    assert torch.equal(plans[0], plans[1]) and not torch.equal(plans[0], plans[2])


def test_a_state_is_not_changed_by_planning_from_it() -> None:
    """State in, state out: planning twice from one state gives the same plan."""
    method, targets = planner(), torch.rand(2, H, 4, generator=torch.Generator().manual_seed(2))
    _, state = method.plan(distance_to(targets), method.initial(2), generators(0, 1))
    before = CEMState(*(part.clone() for part in state))
    first, _ = method.plan(distance_to(targets), state, generators(2, 3))
    second, _ = method.plan(distance_to(targets), state, generators(2, 3))
    assert torch.equal(first.actions, second.actions)
    assert all(torch.equal(now, then) for now, then in zip(state, before, strict=True))


# --- costs that are no numbers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("bound", [0.5, 0.9])
def test_a_cost_that_is_not_a_number_is_never_an_elite_and_never_the_plan(bound: float) -> None:
    """NaN where the cost would be least; against the elites picked by hand, of which there may be less than five."""

    def objective(actions: Tensor) -> Tensor:
        first = actions[..., 0, 0]
        return torch.where(first < bound, torch.nan, first)

    method = planner(num_iterations=1, num_candidates=20, horizon=1)
    state, streams = method.initial(8), generators(*range(8))
    counts = []
    for _ in range(4):
        plan, following = method.plan(recorder := Recorder(objective), state, streams)
        (costs,) = recorder.costs
        assert costs.isnan().any(dim=1).all()
        for b in range(8):
            elites = sorted(cost.item() for cost in costs[b] if not cost.isnan())[:5]
            counts.append(len(elites))
            if not elites:
                assert torch.equal(following.mean[b], state.mean[b])
                continue
            assert plan.cost[b].item() == plan.actions[b, 0, 0].item() == elites[0]
            expected = 0.1 * state.mean[b, 0, 0].item() + 0.9 * sum(elites) / len(elites)
            assert following.mean[b, 0, 0].item() == pytest.approx(expected, abs=1e-6)
        state = following
    assert max(counts) == 5 and (min(counts) < 5) == (bound == 0.9)


def test_where_no_cost_is_a_number_the_distribution_stays() -> None:
    """Closed form: every iteration draws from the first one's distribution; neighbours plan as if alone."""
    targets = torch.rand(3, H, 4, generator=torch.Generator().manual_seed(3))

    def objective(actions: Tensor) -> Tensor:
        costs = distance_to(targets)(actions)
        return torch.cat([costs[:1], nowhere(actions[1:2]), costs[2:]])

    method = planner(initial_mean=0.25)
    plan, state = method.plan(recorder := Recorder(objective), method.initial(3), generators(0, 1, 2))
    assert plan.cost[1] == torch.inf
    assert ((plan.actions >= 0) & (plan.actions <= 1)).all()
    assert torch.equal(state.mean[1], torch.full((H, 4), 0.25))
    (generator,) = generators(1)
    for candidates in recorder.candidates:
        draws = uniform(generator, 50, H, 4)
        expected = truncated_normal(torch.tensor(0.25), torch.tensor(0.5).sqrt(), draws)
        torch.testing.assert_close(candidates[1, -50:], expected)
    neighbours = torch.tensor([0, 2])
    alone, _ = method.plan(distance_to(targets[neighbours]), method.initial(2), generators(0, 2))
    assert torch.equal(plan.actions[neighbours], alone.actions)


@quick
@given(
    mean=st.lists(st.floats(0, 1, width=32), min_size=8, max_size=8),
    variance=st.floats(1e-12, 1e3),
    frequency=st.floats(-1e3, 1e3),
    undefined=st.floats(-1, 1),
    seed=st.integers(0, 2**32 - 1),
)
def test_actions_never_leave_their_bounds(
    mean: list[float], variance: float, frequency: float, undefined: float, seed: int
) -> None:
    """[0, 1], for any distribution and any objective, NaN included: candidates, elites, means and plans."""

    def objective(actions: Tensor) -> Tensor:
        costs = (frequency * actions).sin().sum((-1, -2))
        return torch.where(costs.sin() > undefined, costs, torch.nan)

    method = planner(horizon=2, num_candidates=6, num_elites=3, initial_variance=variance)
    state = CEMState(torch.tensor(mean).view(1, 2, 4), torch.empty(1, 0, 2, 4))
    for step in range(2):
        plan, state = method.plan(recorder := Recorder(objective), state, generators(seed + step))
        for actions in (*recorder.candidates, plan.actions, *state):
            assert ((actions >= 0) & (actions <= 1)).all()  # which NaN is not


# --- the modifications one by one ------------------------------------------------------------------------------------


def test_kept_elites_join_the_next_candidates_and_shifted_the_next_step_s() -> None:
    """Appendix B and Section 4.2: 50 candidates, then 52; the best never gets worse while the objective stays."""
    targets = torch.rand(2, H, 4, generator=torch.Generator().manual_seed(4))
    method = CEMPlanner.load("planner", "cem", horizon=H)
    state, streams = method.initial(2), generators(0, 1)
    for step in range(3):
        elites = state.elites
        plan, state = method.plan(recorder := Recorder(distance_to(targets)), state, streams)
        sizes = [candidates.shape[1] for candidates in recorder.candidates]
        assert sizes == ([50, 52, 52, 52, 52] if step == 0 else [52] * 5)
        if step > 0:
            assert torch.equal(recorder.candidates[0][:, :2], elites)
        best = torch.stack([costs.min(1).values for costs in recorder.costs])
        assert (best.diff(dim=0) <= 0).all() and torch.equal(plan.cost, best[-1])
        for before, costs, after in zip(
            recorder.candidates[:-1], recorder.costs[:-1], recorder.candidates[1:], strict=True
        ):
            for b in range(2):
                first, second = costs[b].argsort()[:2]
                assert torch.equal(after[b, :2], before[b, [first, second]])
        last = recorder.costs[-1].argsort(1)[:, :2]
        for b in range(2):
            kept = recorder.candidates[-1][b, last[b]]
            assert torch.equal(plan.actions[b], kept[0])
            assert torch.equal(state.elites[b], kept[:, [1, 2, 2]])


@pytest.mark.parametrize("momentum", [0.0, 0.1, 0.7])
def test_momentum_is_the_weight_of_the_old_distribution(momentum: float) -> None:
    """Closed form; every candidate is an elite, and nothing is kept."""
    changes: dict[str, Any] = {"num_elites": 50, "num_kept": 0, "momentum": momentum, "initial_mean": 0.2}
    method = planner(num_iterations=2, initial_variance=0.3, **changes)
    method.plan(recorder := Recorder(distance_to(torch.zeros(1, H, 4))), method.initial(1), generators(0))
    first, second = recorder.candidates
    mean = momentum * 0.2 + (1 - momentum) * first.mean(1, keepdim=True)
    variance = momentum * 0.3 + (1 - momentum) * first.var(1, correction=0, keepdim=True)
    (generator,) = generators(0)
    _, draws = (uniform(generator, 50, H, 4) for _ in range(2))
    torch.testing.assert_close(second, truncated_normal(mean, variance.sqrt(), draws), atol=1e-5, rtol=0)


def test_means_are_shifted_and_variances_start_anew() -> None:
    """Closed form: after one iteration in which every candidate is an elite, and from there on."""
    method = planner(num_iterations=1, num_elites=50, num_kept=0, initial_variance=0.05)
    objective = distance_to(torch.rand(1, H, 4, generator=torch.Generator().manual_seed(6)))
    _, state = method.plan(recorder := Recorder(objective), method.initial(1), generators(0))
    mean = 0.1 * 0.5 + 0.9 * recorder.candidates[0].mean(1)
    torch.testing.assert_close(state.mean, torch.stack([mean[:, 1], mean[:, 2], mean[:, 2]], dim=1))
    method.plan(recorder := Recorder(objective), state, generators(9))
    draws = uniform(generators(9)[0], 50, H, 4)
    expected = truncated_normal(state.mean[:, None], torch.tensor(0.05).sqrt(), draws)
    torch.testing.assert_close(recorder.candidates[0], expected)


def test_nothing_is_differentiated() -> None:
    """A gradient would cost time and memory for nothing."""
    weight = torch.ones(4, requires_grad=True)
    seen: list[bool] = []

    def objective(actions: Tensor) -> Tensor:
        costs = (actions * weight).sum((-1, -2))
        seen.append(costs.requires_grad)
        return costs

    plan, state = (method := planner()).plan(objective, method.initial(1), generators(0))
    assert not any([*seen, plan.actions.requires_grad, state.mean.requires_grad])


def test_an_objective_of_another_shape_is_refused() -> None:
    method = planner()
    with pytest.raises(ValueError, match=r"the objective returned shape \[50\]; it must be \[1, 50\]"):
        method.plan(lambda actions: actions.sum((0, -1, -2)), method.initial(1), generators(0))


# --- settings --------------------------------------------------------------------------------------------------------


def test_the_configured_numbers_are_the_paper_s() -> None:
    """Appendix B; the horizon is Section 4.2's, the iterations are ours."""
    actual = CEMPlanner.load("planner", "cem")
    assert (actual.num_candidates, actual.num_elites, actual.num_kept) == (50, 5, 2)
    assert (actual.initial_variance, actual.momentum, actual.horizon) == (0.5, 0.1, 20)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"horizon": 0}, "horizon = 0 is not allowed"),
        ({"num_candidates": 0}, "num_candidates = 0 is not allowed"),
        ({"num_elites": 0}, "num_elites = 0 is not allowed"),
        ({"num_kept": -1}, "num_kept = -1 is not allowed"),
        ({"num_iterations": 0}, "num_iterations = 0 is not allowed"),
        ({"initial_mean": 1.5}, "initial_mean = 1.5 is not allowed"),
        ({"initial_mean": -0.5}, "initial_mean = -0.5 is not allowed"),
        ({"initial_variance": 0.0}, "initial_variance = 0.0 is not allowed"),
        ({"initial_variance": float("nan")}, "initial_variance = nan is not allowed"),
        ({"momentum": 1.0}, "momentum = 1.0 is not allowed"),
        ({"momentum": -0.1}, "momentum = -0.1 is not allowed"),
        ({"kind": "gradient"}, "kind = 'gradient' is not allowed"),
        ({"candidates": 5}, "candidates = 5 is not a known key"),
        ({"num_kept": 6}, "num_kept = 6, num_elites = 5, num_candidates = 50: they must not decrease in this order"),
        ({"num_elites": 51}, "num_kept = 2, num_elites = 51, num_candidates = 50: they must not decrease"),
    ],
)
def test_bad_settings_are_named(changes: dict[str, Any], message: str) -> None:
    """Golden parts of the message."""
    with pytest.raises(ConfigError, match=message):
        planner(**changes)


@pytest.mark.parametrize("seeds", [(0,), (0, 1, 2)])
def test_as_many_generators_as_problems_are_needed(seeds: tuple[int, ...]) -> None:
    """One for all must not pass by broadcasting."""
    method = planner()
    with pytest.raises(ValueError, match="zip"):
        method.plan(distance_to(torch.zeros(2, H, 4)), method.initial(2), generators(*seeds))


def test_plans_and_states_may_meet_autograd() -> None:
    """The search runs in inference mode; what it returns is free of it."""
    plan, state = planner().plan(distance_to(torch.rand(2, H, 4)), planner().initial(2), generators(0, 1))
    for tensor in (*plan, *state):
        assert not tensor.is_inference()
    weight = torch.ones(1, requires_grad=True)
    (weight * plan.actions).sum().backward()
