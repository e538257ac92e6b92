"""Planners of other packages behind one call, for the same search as ours: as many candidates, elites and iterations.

Each adapter builds a planner for an objective `[B, N, H, 4] -> [B, N]` (a cost) and returns a function that plans once
from the beginning. What can be set is set as in `SETTINGS`; the rest is as the peer has it. Each is used in the way
that costs it least, in inference mode, too. What none of them knows: several sets of weights. That is in the objective,
which only peers that plan for many agents at once can take for more than one.
"""

import importlib.util
import io
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import cache
from typing import NamedTuple
from warnings import catch_warnings

import torch
from torch import Tensor

from affmap.planning.cem import CEMPlanner
from affmap.planning.planner import Objective

SETTINGS = CEMPlanner.load("planner", "cem", num_iterations=10)  # as in PlaNet; the experiments take 5
SHAPE = (SETTINGS.horizon, 4)
SIZE = SETTINGS.horizon * 4
STD = SETTINGS.initial_variance**0.5

Plan = Callable[[], Tensor]
"""Plans once from the beginning: actions `[B, H, 4]` in [0, 1]."""


class Peer(NamedTuple):
    """A planner of another package."""

    name: str
    make: Callable[[Objective, int], Plan]
    """From an objective and the number of agents B."""
    batched: bool
    """Whether it plans for B > 1 agents at once."""


def inference(make: Callable[[Objective, int], Plan]) -> Callable[[Objective, int], Plan]:
    """Let an adapter's planner plan in inference mode, which not all of them enter themselves."""
    return lambda objective, num_agents: torch.inference_mode()(make(objective, num_agents))


def bounded(objective: Objective) -> Objective:
    """The objective for a peer that knows no bounds: what is executed, and so what counts, is clamped to them."""
    return lambda actions: objective(actions.clamp(0, 1))


@inference
def pytorch_icem(objective: Objective, num_agents: int) -> Plan:
    """iCEM: one agent, no bounds; colored noise and kept elites by default."""
    from pytorch_icem import iCEM

    cost = bounded(objective)
    with catch_warnings(action="ignore"):  # of how it copies sigma
        planner = iCEM(
            dynamics=lambda state, action: state,  # the whole path is imagined in its cost
            trajectory_cost=lambda states, actions: cost(actions[None])[0],
            nx=1,
            nu=1,
            sigma=STD,
            num_samples=SETTINGS.num_candidates,
            num_elites=SETTINGS.num_elites,
            horizon=SETTINGS.horizon,
            elites_keep_fraction=SETTINGS.num_kept / SETTINGS.num_elites,
            warmup_iters=SETTINGS.num_iterations,
        )
    planner.nu = 4  # its constructor refuses more than one: it compares the number with that of sigma's axes

    def plan() -> Tensor:
        planner.reset()
        planner.mean = torch.full(SHAPE, SETTINGS.initial_mean)
        planner.command(torch.zeros(1), shift_nominal_trajectory=False)
        return planner.kept_elites[:1].clamp(0, 1)  # the best; the call itself returns only its first action

    return plan


@inference
def torchrl(objective: Objective, num_agents: int) -> Plan:
    """CEM with bounds, for B agents; means of 0 and deviations of 1 at first, which cannot be set.

    It steps through an environment. Here a whole plan is one action of one step, because stepping through tensordicts
    would cost it more than all the rest; the candidates are the same.
    """
    from tensordict import TensorDict
    from tensordict.nn import TensorDictModule
    from torchrl.data import Bounded, Composite, Unbounded
    from torchrl.envs.model_based import ModelBasedEnvBase
    from torchrl.modules.planners.cem import CEMPlanner as TorchRLPlanner

    class Imagination(ModelBasedEnvBase):
        def __init__(self) -> None:
            super().__init__(TensorDictModule(self.reward, in_keys=["action"], out_keys=["reward"]))
            self.observation_spec = Composite(agent=Unbounded((1,)))
            self.state_spec = Composite(agent=Unbounded((1,)))
            self.action_spec = Bounded(0, 1, (SIZE,))
            self.reward_spec = Unbounded((1,))

        @staticmethod
        def reward(action: Tensor) -> Tensor:
            return -objective(action.unflatten(-1, SHAPE))[..., None]

        def _reset(self, tensordict: TensorDict, **options: object) -> TensorDict:
            raise NotImplementedError("The planner starts from the state that it is given.")

    planner = TorchRLPlanner(Imagination(), 1, SETTINGS.num_iterations, SETTINGS.num_candidates, SETTINGS.num_elites)
    agents = TensorDict({"agent": torch.zeros(num_agents, 1)}, batch_size=[num_agents])
    return lambda: planner(agents.clone())["action"].unflatten(-1, SHAPE)


@inference
def mbrl(objective: Objective, num_agents: int) -> Plan:
    """CEM with bounds (a truncated normal), one agent; the deviation at first, a quarter, cannot be set."""
    from mbrl.planning import CEMOptimizer

    optimizer = CEMOptimizer(
        num_iterations=SETTINGS.num_iterations,
        elite_ratio=SETTINGS.num_elites / SETTINGS.num_candidates,
        population_size=SETTINGS.num_candidates,
        lower_bound=torch.zeros(SHAPE).tolist(),
        upper_bound=torch.ones(SHAPE).tolist(),
        alpha=SETTINGS.momentum,
        device=torch.device("cpu"),
    )
    mean = torch.full(SHAPE, SETTINGS.initial_mean)
    return lambda: optimizer.optimize(lambda actions: -objective(actions[None])[0], mean)[None]  # it maximises


@inference
def evotorch(objective: Objective, num_agents: int) -> Plan:
    """Functional CEM for B agents, no bounds."""
    from evotorch.algorithms.functional import cem, cem_ask, cem_tell

    cost = bounded(objective)
    agents = (num_agents,) if num_agents > 1 else ()  # its axis of problems slows it down where there is one only
    center = torch.full((*agents, SIZE), SETTINGS.initial_mean)
    ratio = SETTINGS.num_elites / SETTINGS.num_candidates

    def plan() -> Tensor:
        state = cem(center_init=center, stdev_init=STD, parenthood_ratio=ratio, objective_sense="min")
        for _ in range(SETTINGS.num_iterations):
            values = cem_ask(state, popsize=SETTINGS.num_candidates)
            costs = cost(values.view(num_agents, -1, *SHAPE))
            state = cem_tell(state, values, costs.view(values.shape[:-1]))
        return state.center.view(num_agents, *SHAPE).clamp(0, 1)

    return plan


@inference
def stable_worldmodel(objective: Objective, num_agents: int) -> Plan:
    """CEM for B agents, no bounds."""
    name = "stable_worldmodel"
    if name not in sys.modules:  # itself it imports data sets and video, which its planners need nothing of
        spec = importlib.util.find_spec(name)
        if spec is None:
            raise ModuleNotFoundError(f"No module named {name!r}")
        sys.modules[name] = importlib.util.module_from_spec(spec)
    from gymnasium.spaces import Box
    from stable_worldmodel.solver import CEMSolver

    cost = bounded(objective)

    class Model:
        def get_cost(self, info: dict, actions: Tensor) -> Tensor:
            return cost(actions)

    class Horizon:  # what it asks of a configuration
        horizon, action_block = SETTINGS.horizon, 1

    solver = CEMSolver(
        Model(),
        batch_size=num_agents,
        num_samples=SETTINGS.num_candidates,
        var_scale=STD,  # a standard deviation
        n_steps=SETTINGS.num_iterations,
        topk=SETTINGS.num_elites,
    )
    solver.configure(action_space=Box(0, 1, (num_agents, 4)), n_envs=num_agents, config=Horizon)

    def plan() -> Tensor:
        mean = torch.full((num_agents, *SHAPE), SETTINGS.initial_mean)
        with redirect_stdout(io.StringIO()):  # it prints its time
            return solver.solve({"agent": torch.zeros(num_agents, 1)}, mean)["actions"].clamp(0, 1)

    return plan


PEERS = (
    Peer("pytorch-icem", pytorch_icem, batched=False),
    Peer("torchrl", torchrl, batched=True),
    Peer("mbrl", mbrl, batched=False),
    Peer("evotorch", evotorch, batched=True),
    Peer("stable-worldmodel", stable_worldmodel, batched=True),
)


@cache
def available() -> tuple[Peer, ...]:
    """The peers that plan on this machine; of each of the others a line says why it is left out."""
    return tuple(peer for peer in PEERS if _works(peer))


def _works(peer: Peer) -> bool:
    """Whether a peer plans for each number of agents that it is meant for."""
    try:
        for num_agents in (1, 2) if peer.batched else (1,):
            actions = peer.make(lambda actions: actions.sum((-2, -1)), num_agents)()
            if actions.shape != (num_agents, *SHAPE):
                raise ValueError(f"actions of shape {list(actions.shape)}")
    except Exception as error:  # whatever it is: the other peers are compared without it
        print(f"{peer.name} is left out: {type(error).__name__}: {error}", file=sys.stderr)
        return False
    return True
