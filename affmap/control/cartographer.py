"""An agent that plans with a memorised map: it sees only where it is, and remembers codes of other places."""

from __future__ import annotations

from typing import NamedTuple

from affmap.control.agent import Agent
from affmap.control.controller import Decision, Observation
from affmap.control.mpc import AgentState
from affmap.model.lookup import AffordanceMap
from affmap.model.memory import Memory, PlaceNetwork
from affmap.planning.planner import Generators


class Remembering(NamedTuple):
    """State of B agents that remember a map."""

    memory: Memory
    """That of each."""
    lookup: AffordanceMap
    """The map as they remember it."""
    agent: AgentState
    """All else."""


class Cartographer:
    """Steers B vehicles as an `Agent` does, with codes from memory instead of views of the world.

    Attributes:
        agent: plans, and sees the view at each vehicle.
        network: remembers.
        memory: that of M members, or of B agents, as flights begin.
    """

    def __init__(self, agent: Agent, network: PlaceNetwork, memory: Memory) -> None:
        """Give an agent a memory, which takes the place of its look-up."""
        self.agent, self.network, self.memory = agent, network, memory

    def __repr__(self) -> str:
        return f"Cartographer({self.agent!r}, {self.network.num_units} units)"

    def initial(self, num_problems: int) -> Remembering:
        """State before the first step, for B problems; see `Controller`."""
        memory = self.memory.repeated(num_problems // len(self.memory.weights))
        return Remembering(memory, self._painted(memory), self.agent.initial(num_problems))

    def act(self, observation: Observation, state: Remembering, generators: Generators) -> tuple[Decision, Remembering]:
        """Learn the code of the view at each vehicle, if they learn; then plan with the map; see `Controller.act`."""
        memory, lookup = state.memory, state.lookup
        if self.network.settings.learns:
            codes = self.agent.sensed(observation).flatten(0, 1)
            memory = self.network.learned(memory, observation.position, codes)
            lookup = self._painted(memory)
        decision, agent = self.agent.looking_up(lookup).act(observation, state.agent, generators)
        return decision, Remembering(memory, lookup, agent)

    def _painted(self, memory: Memory) -> AffordanceMap:
        """The maps of B agents, nodes as far apart as those of the agent's own map."""
        lookup = self.agent.lookup
        assert isinstance(lookup, AffordanceMap)
        codes = self.network.painted(memory, lookup.spacing)
        return AffordanceMap(codes, [lookup.worlds[0]] * len(codes), lookup.differentiable, lookup.spacing)
