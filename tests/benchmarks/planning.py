"""Planning side by side: our cross-entropy method and those of other packages, the same models and the same objective.

The models are those of the reference run with 8 context units, in the world that they were trained in; agents stand in
the start corners and want to the opposite ones. Each contender plans from the beginning, without a warm start. All
share our imagination of paths, so that what differs is the search around it: drawing candidates, bounds, elites. Peers
have it in PyTorch, as their users would write it, and once more in our compiled loops. Knows nothing of how the others
do it. `python tests/benchmarks/planning.py` lists the costs of their plans.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import mean
from typing import NamedTuple

import torch
from measure import Contender, Result, compare
from peers import SETTINGS, Peer, Plan, available

from affmap import compiled
from affmap.config import sweep
from affmap.control.agent import Agent, ControlSettings, Observation
from affmap.control.controller import Controller
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.model.lookup import AffordanceMap, make_lookup
from affmap.model.stack import Stack
from affmap.model.weights import WEIGHTS, restore
from affmap.pipeline.stage import TRAIN
from affmap.planning.gradient import GradientPlanner
from affmap.planning.planner import Objective
from affmap.random import generator, integer
from affmap.rivals.policy import Network, Policy
from affmap.rivals.settings import Distillation
from affmap.settings import folder
from affmap.store.store import Store

UNIT = "agent and step"


class Cost(NamedTuple):
    """What plans of a contender cost."""

    contender: str
    cost: float
    """Expected free energy, nats."""


@dataclass(frozen=True)
class Agents:
    """B agents, the same number of each of M members (member-major), and what they imagine with."""

    stack: Stack
    lookup: AffordanceMap
    start: Observation
    settings: ControlSettings

    def objective(self, loops: bool = True) -> Objective:
        """What `affmap.control.agent.Agent` minimises, in compiled loops or in PyTorch."""
        with compiled.switched(loops):
            return Agent(self.stack, self.lookup, SETTINGS, self.settings).objective(self.start)

    def alone(self, agent: int) -> "Agents":
        """One of them, with a stack of its own member only."""
        member = agent // (len(self.start.goal) // len(self.stack.seeds))
        own = slice(member, member + 1)
        stack = Stack(self.stack.settings, self.stack.num_channels, self.stack.seeds[own])
        stack.load_state_dict({name: weights[own] for name, weights in self.stack.state_dict().items()})
        return Agents(
            stack.requires_grad_(False),
            AffordanceMap(self.lookup.codes[own].clone(), self.lookup.worlds),
            Observation(*(part[agent : agent + 1] for part in self.start)),
            self.settings,
        )


def reference() -> Agents:
    """The agents of Experiment I before their first step: 25 members x 4, with the reference run's trained models.

    Raises:
        FileNotFoundError: the reference run has no models of the present configuration.
    """
    (config,) = sweep.jobs(["models=reference", "model.context_size=8"])
    trained = Store(folder().parent / config.reference).find(TRAIN.of(config))
    if trained is None:
        raise FileNotFoundError(f"{config.reference} holds no models of this configuration; the benchmark plans them.")
    stack = restore(Stack(config.model, len(config.channels), config.seeds), trained / WEIGHTS)
    stack.requires_grad_(False)
    seen = starts(config.control_layout, config.vehicle, config.control, config.seeds)
    return Agents(stack, make_lookup(config.lookup, stack, [config.control_layout.map]), seen, config.control)


def starts(layout: Layout, vehicle: Vehicle, settings: ControlSettings, seeds: Sequence[int]) -> Observation:
    """Starts and goals as `affmap.control.episodes.control` draws them, as its agents see them."""
    env = VehicleEnv(layout, vehicle, settings.goal_radius)
    observations = [
        env.reset(seed=integer(seed, "start and goal", run), options={"corner": run % 4})[0]
        for seed in seeds
        for run in range(settings.runs_per_member)
    ]
    return Observation.of(observations, settings.device)


def _ours(objective: Objective, num_agents: int) -> Plan:
    generators = [generator(agent, "planner") for agent in range(num_agents)]
    state = SETTINGS.initial(num_agents)
    return lambda: SETTINGS.plan(objective, state, generators)[0].actions


OURS = Peer("affmap", _ours, batched=True)


class Entry(NamedTuple):
    """A planner and the way in which it is to be used."""

    name: str
    peer: Peer
    loops: bool
    """Whether the objective, and the search if it is ours, run in compiled loops."""

    def plan(self, agents: Sequence[Agents]) -> Callable[[], object]:
        """A call plans for groups of agents, one group after the other."""
        plans = [self.peer.make(group.objective(self.loops), len(group.start.goal)) for group in agents]

        def run() -> None:
            with compiled.switched(self.loops):
                for plan in plans:
                    plan()

        return run


def entries(batched: bool = False) -> list[Entry]:
    """Ours and the peers that can be had, or those of them that plan for many agents at once.

    Peers minimise our objective in PyTorch and, "+ our loops", in compiled code.
    """
    peers = [peer for peer in available() if peer.batched or not batched]
    return [
        Entry("affmap", OURS, True),
        Entry("affmap, PyTorch alone", OURS, False),
        *(Entry(peer.name, peer, False) for peer in peers),
        *(Entry(f"{peer.name} + our loops", peer, True) for peer in peers),
    ]


def results(rounds: int) -> list[Result]:
    """Time ours and the peers that can be had, for one agent and for 100.

    Together means on our objective, which holds the weights of all members: no peer has such a thing of its own. One at
    a time is how a peer is used with models of its user's: each contender is given four of the 100, of different
    members and corners, because its time of an agent does not depend on how many there are.
    """
    agents = reference()
    num_agents, flop = len(agents.start.goal), _flop(agents.stack)
    one = [agents.alone(0)] * 8  # several times, because a single plan is too short to be timed well
    four = [agents.alone(agent) for agent in (0, 33, 66, 99)]
    single = [Contender(entry.name, entry.plan(one), len(one)) for entry in entries()]
    together = [
        Contender(f"{entry.name}, together", entry.plan([agents]), num_agents) for entry in entries(batched=True)
    ]
    apart = [
        Contender(f"{entry.name}, one at a time", entry.plan(four), len(four))
        for entry in entries()
        if entry.peer is OURS or not entry.loops
    ]
    work = f"planning, {num_agents} agents with weights of their own ({len(agents.stack.seeds)} members x 4)"
    return [
        *compare("planning, 1 agent", UNIT, single, flop, rounds),
        *compare(work, UNIT, [*together, *apart], flop, rounds),
        *compare(f"gradient planning, {num_agents} agents", UNIT, _gradient(agents), rounds=rounds),
        *compare("acting, 1 agent", UNIT, _acting(agents.alone(0), repeats=20), rounds=rounds),
        *compare(f"acting, {num_agents} agents", UNIT, _acting(agents), rounds=rounds),
    ]


def _acting(agents: Agents, repeats: int = 1) -> list[Contender]:
    """A whole step of the agent, from sensations to actions, and of a policy of the size of the distilled one.

    Its weights are not trained, on which its time does not depend.
    """
    num_agents, seeds = len(agents.start.goal), agents.stack.seeds
    rival = Distillation.load("rival", "distilled")
    channels = agents.start.view.shape[1]
    weights = [torch.Generator().manual_seed(seed) for seed in seeds]
    controllers = {
        "affmap": Agent(agents.stack, agents.lookup, SETTINGS, agents.settings),
        "distilled policy": Policy(Network.of(rival, weights, channels)),
    }

    def contender(name: str, controller: Controller) -> Contender:
        generators = [generator(agent, "planner") for agent in range(num_agents)]
        state = controller.initial(num_agents)

        def run() -> None:
            for _ in range(repeats):
                controller.act(agents.start, state, generators)

        return Contender(name, run, num_agents * repeats)

    return [contender(name, controller) for name, controller in controllers.items()]


def _gradient(agents: Agents) -> list[Contender]:
    """Our gradient-based planner for all agents, also with gradients through the map, and for a quarter of them."""
    through = replace(agents, lookup=AffordanceMap(agents.lookup.codes, agents.lookup.worlds, differentiable=True))
    first = len(agents.start.goal) // len(agents.stack.seeds)
    quarter = replace(agents, start=Observation(*(part[::first] for part in agents.start)))  # one of each member's
    planner = GradientPlanner.load("planner", "gradient")

    def contender(name: str, some: Agents, loops: bool = True) -> Contender:
        objective, state = some.objective(loops), planner.initial(len(some.start.goal))
        return Contender(name, lambda: planner.plan(objective, state, []), len(some.start.goal))

    return [
        contender("affmap", agents),
        contender("affmap, PyTorch alone", agents, loops=False),
        contender("affmap, through the map", through),
        contender("affmap, through the map, PyTorch alone", through, loops=False),
        contender("affmap, a quarter of them", quarter),
    ]


def _flop(stack: Stack) -> float:
    """Floating-point operations of the transition model's products in a plan of ours for an agent."""
    num_weights = (2 + 4 + stack.context_size + 2 + 2) * stack.settings.hidden_size
    num_paths = SETTINGS.num_iterations * (SETTINGS.num_candidates + SETTINGS.num_kept) - SETTINGS.num_kept
    return 2.0 * num_paths * SETTINGS.horizon * num_weights


def costs(num_agents: int = 8) -> list[Cost]:
    """What the plans of each contender cost: means over agents of different members, each planned for alone.

    What is executed counts: actions clamped to the bounds; of contenders that return the mean of elites, that mean.
    All but pytorch-icem, whose noise cannot be seeded, find the same again.
    """
    agents, contenders = reference(), [OURS, *available()]
    step = len(agents.start.goal) // num_agents + 1  # not a multiple of 4: all corners
    objectives = [agents.alone(agent).objective() for agent in range(0, len(agents.start.goal), step)]
    torch.manual_seed(0)
    with torch.no_grad():
        return [
            Cost(peer.name, mean(float(objective(peer.make(objective, 1)()[:, None])) for objective in objectives))
            for peer in contenders
        ]


if __name__ == "__main__":
    torch.set_num_threads(1)
    for name, cost in costs():
        print(f"{name:20} {cost:10.2f}")
