"""Memorised maps of a stage `control`: exploration, an earlier flight, and how wrong codes in memory are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from affmap.config.root import Config
from affmap.control.agent import Agent
from affmap.control.cartographer import Cartographer, Remembering
from affmap.control.controller import Controller, Decision, Observation
from affmap.control.episodes import control
from affmap.data.collect import collect
from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap, node_axes
from affmap.model.memory import Memory, MemorySettings, PlaceNetwork
from affmap.model.stack import Stack
from affmap.model.windows import take_apart
from affmap.planning.planner import Generators
from affmap.results.files import Recall

_AT_ONCE = 4096  # views


class Survey:
    """Steers as a cartographer does, and measures at each step how wrong the codes in its memory are.

    Attributes:
        lookup: the maps as runs begin.
    """

    def __init__(self, pilot: Cartographer, layout: Layout, places: np.ndarray) -> None:
        """Measure at `places` `[Y, X]` bool, nodes of the agent's map of the layout."""
        self.pilot, self._size = pilot, layout.size
        truth = pilot.agent.lookup
        assert isinstance(truth, AffordanceMap)
        self._true, self._spacing = truth.codes, truth.spacing  # [M, Y, X, C]
        self._places = torch.from_numpy(places)
        self._errors: list[Tensor] = []
        self._first: Tensor | None = None
        self._state: Remembering
        self.lookup: AffordanceMap

    def initial(self, num_problems: int) -> Remembering:
        """State before the first step, see `Controller`."""
        self._state = self.pilot.initial(num_problems)
        self.lookup = self._state.lookup
        if self._first is None:
            self._first = self.lookup.codes[0]
            self._errors.append(self._error())
        return self._state

    def act(self, observation: Observation, state: Remembering, generators: Generators) -> tuple[Decision, Remembering]:
        """Decide, see `Controller.act`."""
        decision, self._state = self.pilot.act(observation, state, generators)
        self._errors.append(self._error())
        return decision, self._state

    def keep(self) -> None:
        """Let later flights begin with what is now in memory."""
        self.pilot = Cartographer(self.pilot.agent, self.pilot.network, self._state.memory)

    def _error(self) -> Tensor:
        """Error of the codes in memory, `[B]`, see `Recall`."""
        true = self._true[:, self._places]  # [M, places, C]
        seen = self._state.lookup.codes[:, self._places].unflatten(0, (len(true), -1))
        squares = (seen - true[:, None]).square().sum((-2, -1)) / true.square().sum((-2, -1))[:, None]
        return squares.sqrt().flatten()

    def recall(self, members: Sequence[int]) -> Recall:
        """All measurements; the runs have followed those of an earlier flight, if it flew."""
        assert self._first is not None
        x, y = node_axes(self._size, self._spacing)
        best = int(self._errors[-1][: len(self._errors[-1]) // len(members)].argmin())
        return Recall(
            error=torch.stack(self._errors, 1).numpy(),
            earlier=np.array(self.pilot.network.settings.early_steps),
            true=self._true[0].numpy(),
            at_first=self._first.numpy(),
            at_last=self._state.lookup.codes[best].numpy(),
            best=np.array(best),
            x=x.numpy(),
            y=y.numpy(),
            member=np.repeat(members, len(self._state.memory.weights) // len(members)),
        )


def surveyed(config: Config, agent: Controller, layout: Layout, settings: MemorySettings) -> Survey:
    """A survey of an agent with a memory, after exploration and the earlier flight."""
    assert isinstance(agent, Agent)
    network = PlaceNetwork(layout.size, settings)
    explored = config.training_layouts[0] if settings.explored == "training" else layout
    survey = Survey(
        Cartographer(agent, network, _explored(config, agent.stack, network, explored)),
        layout,
        _changed(agent, layout, explored, config.vehicle.radius),
    )
    if settings.early_steps:
        early = config.control.model_copy(update={"num_steps": settings.early_steps})
        control(survey, [layout], config.vehicle, early, config.pilots, seed=1)
        survey.keep()
    return survey


def _explored(config: Config, stack: Stack, network: PlaceNetwork, layout: Layout) -> Memory:
    """Memories of the members after exploration of a layout, as long as that of the data, or after none."""
    if network.settings.explored == "nothing":
        return network.empty(len(stack.seeds), stack.context_size)
    arrays = collect([layout], config.vehicle, config.data)
    views = torch.from_numpy(arrays["view"]).flatten(0, 1)
    with torch.no_grad():
        codes = torch.cat([stack.encode(take_apart(part[None])) for part in views.split(_AT_ONCE)], 1)
    return network.explored(torch.from_numpy(arrays["position"][:, :-1]).flatten(0, 1), codes)


def _changed(agent: Agent, layout: Layout, explored: Layout, radius: float) -> np.ndarray:
    """Free nodes of the agent's map of a layout whose views were others in an explored one; all free ones, if none."""
    lookup = agent.lookup
    assert isinstance(lookup, AffordanceMap)
    nodes = np.stack(np.meshgrid(*(axis.numpy() for axis in node_axes(layout.size, lookup.spacing))), axis=-1)
    free = layout.is_free(nodes, radius)
    changed = free & (layout.views(nodes) != explored.views(nodes)).any((-3, -2, -1))
    return changed if changed.any() else free
