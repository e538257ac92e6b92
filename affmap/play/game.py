"""The game: a layout, a vehicle, an agent, and everything that the player may change. Knows no pixels and no keys."""

from collections.abc import Sequence
from contextlib import suppress
from functools import cache, lru_cache
from itertools import count
from typing import NamedTuple

import numpy as np
import torch

from affmap.control import pretrained
from affmap.control.agent import Agent
from affmap.control.pilot import Pilot, Thought
from affmap.control.settings import GUIDES
from affmap.control.time_to_go import TimeToGo
from affmap.env.layout import Layout
from affmap.env.procedural import Procedural, first_layout, load
from affmap.env.vehicle import VehicleEnv
from affmap.model.lookup import AffordanceMap, LookupSettings, make_lookup
from affmap.model.palette import Palette
from affmap.model.stack import Stack
from affmap.settings import ConfigError, names

BETAS, LOOKUPS = (0.0, 1.0, 10.0, 100.0), ("map", "exact")
GROUND_SPACING = 0.04
"""Spacing of the nodes of the displayed map, u; painting takes a hundredth of a second."""

GRAB = 0.05
"""Distance outside a circle at which a click still grabs it, u."""


class Setting(NamedTuple):
    """Settings of the agent that the player may change."""

    context_size: int
    planner: str
    beta: float
    lookup: str
    guide: str


class Game:
    """A flight that never ends.

    Attributes:
        worlds: names of the worlds that the agent can see.
        planners: names of the planners that it can have.
        world: name of the world, which circles may have been moved in since.
        layout: the world as flights in it begin; `env.layout` is the present one, in which doors may be open.
        env: the vehicle in it.
        setting: the settings of the agent.
        by_hand: whether the player flies; else the agent does.
        throttles: `[4]`, the player's action.
        thought: the plan behind the agent's last action; None before it has acted.
        past: true positions since the last reset, `[2]` each, u.
        in_fog: whether the vehicle is in fog.
        ground: `[Y, X, 3]`, the affordance map in colours; None without a context code.
        transition: the transition model of the agent; None for the first that the experiment has.
        message: a sentence for the player on an action that was not possible.
    """

    def __init__(
        self,
        source: str = "exp1",
        world: str | None = None,
        context_size: int | None = None,
        transition: str | None = None,
    ) -> None:
        """Load the models of an experiment (see `affmap.load`).

        Raises:
            ConfigError: there are no such models or world, or they do not fit each other.
        """
        self.source, self.origin, self.transition = source, pretrained.origin(source), transition
        size = self.origin.context_sizes[-1] if context_size is None else context_size
        beta = pretrained.load(source, context_size=size, transition=transition).settings.beta
        self.setting = Setting(size, self.origin.planner, beta, LOOKUPS[0], GUIDES[0])
        self.worlds = _worlds(self.origin.channels)
        self.planners = sorted({self.origin.planner, *names("planner")})
        self.by_hand, self.throttles, self.message = False, np.zeros(4), ""
        self._seeds = count()
        self._lines = lru_cache(maxsize=1)(TimeToGo.lines)  # drawn 30 times a second
        self._load = cache(self._make)  # so that moving a circle reads no files
        home = self.origin.layout if self.origin.layout in self.worlds else self.worlds[0]  # not a random one
        self.enter(world or home)

    def enter(self, world: str) -> None:
        """Start afresh in a world.

        Raises:
            ConfigError: the agent cannot see it, or it does not exist.
        """
        layout = first_layout(world, seed=0)
        if world not in self.worlds:
            raise ConfigError(f"world {world!r} is not one that these models can see: {', '.join(self.worlds)}.")
        self.world, self.layout = world, layout
        self.env = VehicleEnv(self.layout, self.origin.vehicle)
        self._take_controls(new_colors=True)
        self.reset()

    def reset(self) -> None:
        """Start in a corner, with the goal in the opposite one."""
        self._observation, info = self.env.reset(seed=next(self._seeds))
        self._pilot.reset()
        self._follow_doors()
        self.past, self.in_fog = [info["position"]], info["in_fog"]
        self.thought: Thought | None = None

    def change(self, **values: object) -> None:
        """Change settings of the agent in flight; see `Setting`."""
        before, self.setting = self.setting, self.setting._replace(**values)  # type: ignore[arg-type]
        self._take_controls(new_colors=before.context_size != self.setting.context_size)

    def step(self, paused: bool = False) -> None:
        """Fly for a step; while `paused`, the agent only plans."""
        if self.by_hand:
            action, self.thought = self.throttles, None
        elif not paused:
            action, self.thought = self._pilot(self._observation), self._pilot.thought
        elif self.thought is None:  # it plans once, without flying
            self.thought = self._pilot.consider(self._observation)
        if not paused:
            self._observation, _, _, _, info = self.env.step(action)
            self.past.append(info["position"])
            self.in_fog = info["in_fog"]
            self._follow_doors()

    def set_goal(self, goal: Sequence[float]) -> None:
        """Fly to a point of the arena `[2]`, u."""
        self.env.goal = np.clip(goal, 0, self.layout.size)
        self._observation["goal"] = self.env.goal.astype(np.float32)
        self.thought = None

    def circle_at(self, point: Sequence[float]) -> int | None:
        """Index of the circle at a point `[2]` (u), the smallest of several; None if there is none."""
        gaps = [np.hypot(*np.subtract(point, circle.center)) - circle.radius for circle in self.layout.circles]
        there = [circle in self.env.layout.circles for circle in self.layout.circles]
        hit = [number for number, gap in enumerate(gaps) if gap < GRAB and there[number]]
        return min(hit, key=lambda number: self.layout.circles[number].radius, default=None)

    def move_circle(self, number: int, center: Sequence[float]) -> None:
        """Move a circle to a point `[2]` (u); if that is impossible it stays, and `message` says why."""
        values = self.layout.model_dump()
        values["circles"][number]["center"] = tuple(np.clip(center, 0, self.layout.size).tolist())
        layout = Layout.model_validate(values)
        try:
            env = VehicleEnv(layout, self.origin.vehicle)
            options = {"position": self.past[-1], "goal": self.env.goal}
            observation, info = env.reset(seed=next(self._seeds), options=options)
        except ValueError:
            self.message = "A circle may cover neither a start corner nor the vehicle."
            return
        self.message = ""
        self.layout, self.env, self._observation, self.in_fog = layout, env, observation, info["in_fog"]
        self._take_controls(new_colors=False)

    @property
    def view(self) -> np.ndarray:
        """Present view of the vehicle, `[K, 11, 11]` bool."""
        return self.env.probe(self.past[-1])

    @property
    def code(self) -> np.ndarray:
        """Context code at the vehicle's position, `[C]`."""
        position = torch.from_numpy(self.past[-1]).float()[None, None]
        agent = self._pilot.agent
        assert isinstance(agent, Agent)
        return agent.lookup(position)[0, 0].numpy()

    @property
    def way(self) -> np.ndarray | None:
        """Shortest way from the vehicle to the goal by the agent's map of times to go, `[points, 2]` in u."""
        made = self._pilot.time_to_go
        if made is None or self.by_hand or not np.allclose(made.goals, self._observation["goal"]):
            return None
        return made.paths(self.past[-1][None])[0]

    @property
    def times(self) -> list[np.ndarray]:
        """Lines of equal times to go by that map, `[points, 2]` each in u; none where it is not followed."""
        made = self._pilot.time_to_go
        return [] if made is None or self.way is None else self._lines(made)

    @property
    def distance(self) -> float:
        """Distance from the vehicle to the goal, u."""
        return float(np.hypot(*(self.past[-1] - self.env.goal)))

    def _follow_doors(self) -> None:
        """Put a new agent at the controls where doors have opened, whoever flies, or are closed again."""
        if self.env.layout is not self._flown:
            self._take_controls(new_colors=False)

    def _take_controls(self, new_colors: bool) -> None:
        """Put a new agent at the controls after a change of settings or layout."""
        self._flown = self.env.layout
        context_size, planner, beta, lookup, guide = self.setting
        agent = self._load(context_size, planner, lookup)
        agent.settings = agent.settings.model_copy(update={"beta": beta, "guide": guide})
        self._pilot = Pilot(agent, self._flown, seed=next(self._seeds))
        self.thought = None
        self.ground = self._paint(agent.stack, new_colors) if context_size else None

    def _make(self, context_size: int, planner: str, lookup: str) -> Agent:
        own = planner == self.origin.planner  # then with the experiment's own settings
        agent = pretrained.load(
            self.source, context_size=context_size, planner=None if own else planner, transition=self.transition
        )
        agent.lookup = make_lookup(LookupSettings.load("lookup", lookup), agent.stack, [self.layout.map])
        return agent

    def _paint(self, stack: Stack, new_colors: bool) -> np.ndarray:
        codes = AffordanceMap.paint(stack, [self._flown.map], GROUND_SPACING).codes[0].numpy()
        if new_colors:  # otherwise they would change while a circle is moved
            self._palette = Palette.fit(codes.reshape(-1, codes.shape[-1]))
        return self._palette(codes)


def _worlds(channels: tuple[str, ...]) -> list[str]:
    """Names of the layouts with the given channels: fixed ones, and those of walls, of which there is one each."""
    worlds = []
    for name in names("layout"):
        with suppress(ConfigError):  # the sentence about a broken file is for those who ask for it
            layout = load(name)
            if not isinstance(layout, Procedural) and layout.channels == channels:
                worlds.append(name)
    return worlds
