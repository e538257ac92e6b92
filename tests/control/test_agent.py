"""One decision at a time: what a planner is asked to minimise, what is expected, and each agent alone."""

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from affmap.control.agent import Agent, ControlSettings, Decision, Observation, prediction_error
from affmap.env.layout import Layout
from affmap.gaussian import Gaussian
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import ModelSettings, Stack
from affmap.model.transition import MLP, Carry
from affmap.model.windows import take_apart
from affmap.planning.cem import CEMPlanner
from affmap.planning.gradient import GradientPlanner
from affmap.planning.planner import Generators, Objective, Plan, Planner
from affmap.settings import ConfigError
from affmap.view import view

pytestmark = pytest.mark.usefixtures("loops")

WORLD = Layout.load("layout", "original").map
SEEDS, AGENTS, H = (4, 5), 3, 3
B = len(SEEDS) * AGENTS


def stack(*seeds: int, context_size: int = 3, transition: str = "mlp") -> Stack:
    changes = {"context_size": context_size, "transition": {"kind": transition}}
    return Stack(ModelSettings.load("model", "default", **changes), WORLD.num_channels, seeds)


def observations(seed: int = 0) -> Observation:
    """B vehicles, not all near their goals; reported positions off the true ones, as in fog."""
    generator = torch.Generator().manual_seed(seed)
    size = torch.tensor(WORLD.size)
    position, goal = (torch.rand(B, 2, generator=generator) * size for _ in range(2))
    goal[1], goal[4] = position[1] + 0.1, position[4] - 0.1
    delta = 0.1 * torch.randn(B, 2, generator=generator)
    true = torch.rand(B, 2, generator=generator) * size
    return Observation(position, delta, view(WORLD, true), goal)


class Fixed:
    """A planner that plans what it is told, and remembers what it was given."""

    horizon = H

    def __init__(self, actions: Tensor) -> None:
        self.actions = actions
        self.objective: Objective | None = None
        self.states: list[Any] = []

    def initial(self, num_problems: int, device: torch.device | str = "cpu") -> int:
        self.states.append((num_problems, device))
        return 7

    def plan(self, objective: Objective, state: Any, generators: Generators) -> tuple[Plan, Any]:
        self.objective = objective
        self.states.append((state, generators))
        return Plan(self.actions, torch.zeros(len(self.actions))), state + 1


def random_actions(*shape: int) -> Tensor:
    return torch.rand(*shape, H, 4, generator=torch.Generator().manual_seed(9))


@pytest.mark.parametrize("context_size", [0, 3])
@pytest.mark.parametrize("beta", [0.0, 1.0, 10.0])
def test_planners_minimise_the_expected_free_energy_of_imagined_paths(context_size: int, beta: float) -> None:
    """torch.distributions along each candidate's path; every problem its own goal, 0.01 u wide within 0.5 u."""
    whole, seen = stack(*SEEDS, context_size=context_size), observations()
    lookup = ExactLookup(whole, [WORLD])
    planner = Fixed(random_actions(B))
    agent = Agent(whole, lookup, planner, ControlSettings.load("control", "default", beta=beta))
    agent.act(seen, agent.initial(B), [])
    assert planner.objective is not None
    actions = random_actions(B, 5)
    found = planner.objective(actions)
    path = rollout(whole.transition, lookup, Situation(seen.position, seen.delta, ()), actions)
    near = (seen.position - seen.goal).norm(dim=-1) < 0.5
    assert near.any() and not near.all()
    for b in range(B):
        for n in range(5):
            there = Normal(path.mean[b, n], path.log_std[b, n].exp())
            desired = Normal(seen.goal[b].expand(H, 2), 0.01 if near[b] else 0.1)
            terms = kl_divergence(there, desired) + beta * there.entropy()
            torch.testing.assert_close(found[b, n], terms.sum(-1).mean(), rtol=1e-4, atol=1e-4)


def test_the_first_action_of_the_plan_is_executed_and_states_are_handed_on() -> None:
    """Golden values."""
    whole, seen = stack(*SEEDS), observations()
    planner = Fixed(random_actions(B))
    agent = Agent(whole, ExactLookup(whole, [WORLD]), planner, ControlSettings.load("control", "default"))
    streams = [np.random.default_rng() for _ in range(B)]
    decision, state = agent.act(seen, agent.initial(B), streams)
    assert torch.equal(decision.action, planner.actions[:, 0])
    assert state.planner == 8 and planner.states == [(B, "cpu"), (7, streams)]


@pytest.mark.parametrize(
    ("candidates", "told"),
    [
        (
            random_actions(B),
            r"have the shape \[6, 3, 4\] and the type torch\.float32; they should be a tensor \[6, N, H",
        ),
        (random_actions(B, 5)[:-1], r"have the shape \[5, 5, 3, 4\]"),
        (random_actions(B, 5)[..., :3], r"have the shape \[6, 5, 3, 3\]"),
        (random_actions(B, 0), r"have the shape \[6, 0, 3, 4\]"),
        (
            random_actions(B, 5).double(),
            r"have .* the type torch\.float64; they should be a tensor \[6, N, H, 4\] of torch\.float32",
        ),
        (random_actions(B, 5).numpy(), r"have the type ndarray; they should be a tensor"),
    ],
)
def test_candidates_of_another_kind_are_told(candidates: Any, told: str) -> None:
    """Golden parts of the sentence, by the class of the planner."""

    class Asking(Fixed):
        def plan(self, objective: Objective, state: Any, generators: Generators) -> tuple[Plan, Any]:
            objective(candidates)
            return super().plan(objective, state, generators)

    whole, seen = stack(*SEEDS), observations()
    agent = Agent(
        whole, ExactLookup(whole, [WORLD]), Asking(random_actions(B)), ControlSettings.load("control", "default")
    )
    with pytest.raises(ValueError, match=f"^the candidates of Asking {told}"):
        agent.act(seen, agent.initial(B), [])


@pytest.mark.parametrize(
    ("returned", "told"),
    [
        (
            (Plan(random_actions(B, 1), torch.zeros(B)), 0),
            r"^the actions of the plan of Own have the shape \[6, 1, 3, 4\]",
        ),
        (
            (Plan(random_actions(1), torch.zeros(1)), 0),
            r"have the shape \[1, 3, 4\] .* a tensor \[6, H, 4\] of torch\.float32",
        ),
        ((Plan(random_actions(B).double(), torch.zeros(B)), 0), r"the type torch\.float64; they should be"),
        (
            Plan(random_actions(B), torch.zeros(B)),
            r"^Own\.plan returned the type Plan; it should return a tuple of a Plan and the state",
        ),
        (
            None,
            r"^Own\.plan returned the type NoneType; it should return a tuple of a Plan and the state for the",
        ),
        (random_actions(2), r"^Own\.plan returned the type Tensor"),
        (
            (Plan(random_actions(B) + 1.25, torch.zeros(B)), 0),
            r"^the first action of a plan of Own has [12]\.\d+; it should be in \[0, 1\]\.$",
        ),
        ((Plan(random_actions(B) * torch.nan, torch.zeros(B)), 0), r"^the first action of a plan of Own has nan; it"),
    ],
)
def test_a_plan_of_another_kind_is_told(returned: Any, told: str) -> None:
    """Golden parts of the sentence, by the class of the planner."""

    class Own(Fixed):
        def plan(self, objective: Objective, state: Any, generators: Generators) -> Any:
            return returned

    whole, seen = stack(*SEEDS), observations()
    agent = Agent(
        whole, ExactLookup(whole, [WORLD]), Own(random_actions(B)), ControlSettings.load("control", "default")
    )
    with pytest.raises(ValueError, match=told):
        agent.act(seen, agent.initial(B), [])


class Counting(MLP):
    """A recurrent model that counts the steps, and expects to move as far."""

    def initial(self, num_sequences: int = 1) -> Carry:
        return (torch.zeros(len(self.output_weight), num_sequences, 2),)

    def step(self) -> Any:
        def step(carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
            count = carry[0] + 1
            return (count,), Gaussian(count, torch.zeros_like(count))

        return step


def test_a_recurrent_model_remembers_what_was_executed_and_forgets_what_was_imagined() -> None:
    """Counted by hand; also by a stack of some of its members."""
    settings = ModelSettings.load("model", "default", context_size=3)
    whole = Stack(settings, WORLD.num_channels, SEEDS, Counting)
    for some, seeds in ((whole, SEEDS), (whole.select([1]), SEEDS[1:2])):
        num_problems = len(seeds) * AGENTS
        planner = Fixed(random_actions(num_problems))
        agent = Agent(some, ExactLookup(some, [WORLD]), planner, ControlSettings.load("control", "default"))
        seen = Observation(*(part[:num_problems] for part in observations()))
        state = agent.initial(num_problems)
        for step in range(3):
            decision, state = agent.act(seen, state, [])
            torch.testing.assert_close(decision.delta.mean, torch.full((num_problems, 2), step + 1.0))
            moves = decision.path.mean - torch.cat([seen.position[:, None], decision.path.mean[:, :-1]], dim=1)
            counts = torch.arange(H) + step + 1.0
            torch.testing.assert_close(moves, counts[:, None].expand(num_problems, H, 2))


@torch.no_grad()
def test_a_recurrent_agent_imagines_from_the_state_that_its_flight_has_left() -> None:
    """PyTorch's own cell for each vehicle alone: the state follows from views and executed actions; candidates start
    from the state before the step, with codes looked up where they would be."""
    whole = stack(*SEEDS, transition="gru")
    lookup, planner = AffordanceMap.paint(whole, [WORLD], 0.1), Fixed(random_actions(B))
    agent = Agent(whole, lookup, planner, ControlSettings.load("control", "default"))
    flight = [observations(step) for step in range(3)]
    state, decisions = agent.initial(B), []
    for seen in flight:
        decision, state = agent.act(seen, state, [])
        decisions.append(decision)
    for b in range(B):
        member = b // AGENTS
        weights = {name: value[member] for name, value in whole.transition.state_dict().items()}
        cell = torch.nn.GRUCell(6 + 3, 32)
        names = ("input_weight", "hidden_weight", "input_bias", "hidden_bias")
        for parameter, name in zip(cell.parameters(), names, strict=True):
            parameter.copy_(weights[name].movedim(0, -1))

        def step(code: Tensor, delta: Tensor, action: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
            """The next state, and means and logarithms of deviations."""
            hidden = cell(torch.cat([4 * delta, action, code])[None], hidden)  # noqa: B023
            outputs = hidden[0] @ weights["output.weight"] + weights["output.bias"]  # noqa: B023
            return hidden, torch.cat([outputs[:2] / 4, (outputs[2:].exp() / 4).log()])

        hidden, plan = torch.zeros(1, 32), planner.actions[b]
        for seen, decision in zip(flight, decisions, strict=True):
            position, delta, imagined = seen.position[b], seen.delta[b], hidden
            for t in range(H):
                code = lookup(position.expand(len(SEEDS), 1, 2))[member, 0]
                imagined, outputs = step(code, delta, plan[t], imagined)
                delta = outputs[:2]
                position = position + delta
                torch.testing.assert_close(decision.path.mean[b, t], position, atol=1e-5, rtol=0)
            code = whole.encode(take_apart(seen.view[b][None, None]))[member, 0]
            hidden, outputs = step(code, seen.delta[b], plan[0], hidden)
            torch.testing.assert_close(torch.cat([part[b] for part in decision.delta]), outputs, atol=1e-5, rtol=0)


def test_the_expected_path_is_that_of_the_plan() -> None:
    """Against the imagined path of each plan alone, from the reported position."""
    whole, seen = stack(*SEEDS), observations()
    planner = Fixed(random_actions(B))
    agent = Agent(whole, ExactLookup(whole, [WORLD]), planner, ControlSettings.load("control", "default"))
    decision, _ = agent.act(seen, agent.initial(B), [])
    for b in range(B):
        alone, one = stack(SEEDS[b // AGENTS]).requires_grad_(False), slice(b, b + 1)
        start = Situation(seen.position[one], seen.delta[one], ())
        path = rollout(alone.transition, ExactLookup(alone, [WORLD]), start, planner.actions[one, None])
        torch.testing.assert_close(decision.path.mean[b], path.mean[0, 0])
        torch.testing.assert_close(decision.path.log_std[b], path.log_std[0, 0])


@pytest.mark.parametrize("context_size", [0, 3])
def test_the_expected_change_is_predicted_from_the_view_as_in_training(context_size: int) -> None:
    """The transition model of each vehicle's own member in plain NumPy (Appendix A), and the vehicle's own view."""
    whole, seen = stack(*SEEDS, context_size=context_size), observations()
    planner = Fixed(random_actions(B))
    lookup = AffordanceMap.paint(whole, [WORLD], 0.5)  # not what predictions of the next step are made from
    agent = Agent(whole, lookup, planner, ControlSettings.load("control", "default"))
    decision, _ = agent.act(seen, agent.initial(B), [])
    for b in range(B):
        member = b // AGENTS
        code = stack(SEEDS[member], context_size=context_size).encode(take_apart(seen.view[b][None, None]))[0, 0]
        inputs = np.concatenate([4 * seen.delta[b], planner.actions[b, 0], code.detach()])
        weights = {name: value.numpy()[member] for name, value in whole.transition.state_dict().items()}
        hidden = np.tanh(inputs @ weights["hidden_weight"])
        outputs = hidden @ weights["output_weight"] + weights["output_bias"]
        np.testing.assert_allclose(decision.delta.mean[b], outputs[:2] / 4, atol=1e-6)
        np.testing.assert_allclose(decision.delta.log_std[b].exp(), np.exp(outputs[2:]) / 4, rtol=1e-5)


def test_prediction_error_is_minus_the_log_density() -> None:
    """torch.distributions; it says nothing about the path."""
    generator = torch.Generator().manual_seed(0)
    mean, log_std, delta = (torch.randn(B, 2, generator=generator) for _ in range(3))
    path = Gaussian(torch.full((B, H, 2), torch.nan), torch.full((B, H, 2), torch.nan))
    found = prediction_error(Decision(torch.zeros(B, 4), path, Gaussian(mean, log_std)), delta)
    torch.testing.assert_close(found, -Normal(mean, log_std.exp()).log_prob(delta).sum(-1))


PLANNERS: dict[str, Planner] = {
    "cem": CEMPlanner.load("planner", "cem", horizon=H, num_candidates=8, num_iterations=2),
    "gradient": GradientPlanner.load("planner", "gradient", horizon=H, num_iterations=4, learning_rate=0.05),
}


@pytest.mark.parametrize("kind", PLANNERS)
@pytest.mark.parametrize("context_size", [0, 3])
@pytest.mark.parametrize("transition", ["mlp", "gru"])
def test_agents_together_are_each_alone(kind: str, context_size: int, transition: str) -> None:
    """Two steps; each agent with a stack of its own member, its own generator and its own planner's state."""
    settings = ControlSettings.load("control", "default")

    def decide(seeds: tuple[int, ...], agents: slice) -> list[Decision]:
        whole = stack(*seeds, context_size=context_size, transition=transition)
        agent = Agent(whole, AffordanceMap.paint(whole, [WORLD], 0.1), PLANNERS[kind], settings)
        numbers = range(B)[agents]
        streams = [np.random.default_rng(number) for number in numbers]
        state, decisions = agent.initial(len(numbers)), []
        for step in range(2):
            seen = Observation(*(part[agents] for part in observations(step)))
            decision, state = agent.act(seen, state, streams)
            decisions.append(decision)
        return decisions

    together = decide(SEEDS, slice(None))
    assert ((together[1].action >= 0) & (together[1].action <= 1)).all()
    assert (together[1].action[0] - together[1].action[AGENTS]).abs().max() > 1e-3
    for b in range(B):
        alone = decide((SEEDS[b // AGENTS],), slice(b, b + 1))
        for whole, part in zip(together, alone, strict=True):
            torch.testing.assert_close(whole.action[b], part.action[0], atol=1e-4, rtol=0)
            for wholes, parts in ((whole.path, part.path), (whole.delta, part.delta)):
                torch.testing.assert_close(wholes.mean[b], parts.mean[0], atol=1e-4, rtol=0)
                torch.testing.assert_close(wholes.log_std[b], parts.log_std[0], atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_steps": 0}, "num_steps = 0 is not allowed"),
        ({"runs_per_member": 0}, "runs_per_member = 0 is not allowed"),
        ({"beta": -1.0}, "beta = -1.0 is not allowed"),
        ({"goal_std_far": 0.0}, "goal_std_far = 0.0 is not allowed"),
        ({"goal_std_near": -0.1}, "goal_std_near = -0.1 is not allowed"),
        ({"near_distance": 0.0}, "near_distance = 0.0 is not allowed"),
        ({"goal_radius": float("nan")}, "goal_radius = nan is not allowed"),
        ({"device": "gpu"}, "device = 'gpu' is not allowed"),
    ],
)
def test_bad_settings_are_named(changes: dict[str, Any], message: str) -> None:
    """Golden parts of the message."""
    with pytest.raises(ConfigError, match=message):
        ControlSettings.load("control", "default", **changes)


@pytest.mark.parametrize("transition", ["mlp", "gru"])
def test_where_reports_are_noisy_plans_begin_with_the_sensed_view_and_count_means(transition: str) -> None:
    """Imagination with codes of the views, and as costs squared distances to goals, up to a constant."""
    whole, seen = stack(*SEEDS, transition=transition).requires_grad_(False), observations()
    lookup, settings = (
        ExactLookup(whole, [WORLD]),
        ControlSettings.load("control", "default", reports="noisy", beta=5.0),
    )
    agent, actions = Agent(whole, lookup, Fixed(random_actions(B)), settings), random_actions(B, 4)
    carry = agent.initial_carry(B)
    codes = whole.encode(take_apart(seen.view[None])).unflatten(1, (len(SEEDS), AGENTS))
    own = torch.stack([codes[member, member] for member in range(len(SEEDS))])
    situation = Situation(seen.position, seen.delta, carry)
    path = rollout(whole.transition, lookup, situation, actions, code=own)
    found = agent.imagine(seen, actions, carry)
    torch.testing.assert_close(found.mean, path.mean, atol=1e-5, rtol=0)
    torch.testing.assert_close(found.log_std, path.log_std, atol=1e-4, rtol=0)
    squares = (path.mean - seen.goal[:, None, None]).square().sum(-1).mean(-1)  # [B, 4]
    costs = agent.objective(seen, carry)(actions)
    expected = squares / (2 * agent.goal_std(seen)[:, None] ** 2)
    torch.testing.assert_close(costs - costs[:, :1], expected - expected[:, :1], rtol=1e-3, atol=1e-3)
