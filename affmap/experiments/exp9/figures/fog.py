"""A flight through the fog: the true path, the believed one, and the hidden units along it."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from torch import Tensor

from affmap.control.agent import Agent
from affmap.control.controller import Decision, Observation
from affmap.control.episodes import control
from affmap.control.mpc import AgentState
from affmap.control.pretrained import read_members
from affmap.control.settings import ControlSettings
from affmap.env.layout import Layout
from affmap.env.scene import circle_marks
from affmap.experiments.exp9.claims import LIT, MODEL
from affmap.model.lookup import LookupSettings, make_lookup
from affmap.planning.cem import CEMPlanner
from affmap.planning.planner import Generators
from affmap.report.drawing import arena
from affmap.report.drawing.colors import name_of
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results import belief
from affmap.results.files import Trajectories
from affmap.results.setting import LAYOUT, ReportSettings, Setting
from affmap.results.tables import Results
from affmap.threads import limited

RUN = 0
"""The run that is shown, of the first member: from the lower left corner."""

BELIEVED = "#d55e00"


class Flight(NamedTuple):
    """A flight of one vehicle, T steps."""

    paths: Trajectories
    hidden: np.ndarray
    """`[T, H]`, hidden state after each step; H is 0 for a model without one."""
    layout: Layout


class Recorder:
    """A controller that flies as an agent does, and keeps its hidden states."""

    def __init__(self, agent: Agent) -> None:
        """Fly as `agent`, one member of it and one vehicle."""
        self._agent = agent
        self.hidden: list[Tensor] = []
        self.initial = agent.initial

    def act(self, observation: Observation, state: AgentState, generators: Generators) -> tuple[Decision, AgentState]:
        """Decide as the agent does."""
        decision, state = self._agent.act(observation, state, generators)
        self.hidden.append(state.carry[0][0, 0] if state.carry else observation.position.new_empty(0))
        return decision, state


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    layout = LIT if LIT in results.layouts else results.layouts[0]
    chosen = results.where({LAYOUT.key: layout})
    figure = new_figure(4.1)
    grid = figure.subplots(2, len(chosen), squeeze=False, height_ratios=[3, 2])
    with limited(1):
        flights = [fly_again(results, setting) for setting in chosen]
    for (upper, lower), setting, flight in zip(grid.T, chosen, flights, strict=True):
        upper.set_title(name_of(MODEL, setting.values.get(MODEL.key, ""), settings), loc="left")
        _paths(upper, flight)
        _units(lower, flight)
    arena.label_outer(grid[:1], len(chosen))
    for ax in grid[1, 1:]:
        ax.label_outer()
    grid[1, 0].set_ylabel("hidden unit")
    handles = [
        Line2D([], [], color="black", lw=1.2, label="true path"),
        Line2D([], [], color=BELIEVED, ls="", marker="o", ms=3, mfc="none", label="believed positions"),
        Line2D([], [], color="black", ls="", label="goal", **arena.SIGNS["cross"]),
        *arena.effect_handles([flights[0].layout]),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return Drawn(figure, _caption(results, layout, flights, settings))


def fly_again(results: Results, setting: Setting) -> Flight:
    """Fly the run that is shown again, because hidden states are not kept."""
    folder, config = setting.train[0], results.provenance[setting.control[0]]["config"]
    world, member = results.run_layouts(setting)[0], int(results.trajectories(setting).member[0])
    stack, losses = read_members(folder.parent, folder.name, [folder.name], [member])
    lookup = make_lookup(LookupSettings.model_validate(config["lookup"]), stack, [world.map])
    values: dict[str, Any] = {"device": "cpu", **config["control"], "runs_per_member": RUN + 1}
    rules, planner = ControlSettings.model_validate(values), CEMPlanner.model_validate(config["planner"])
    vehicle = results.vehicle(setting)
    recorder = Recorder(Agent(stack, lookup, planner, rules, world.channels, vehicle, losses))
    runs = control(recorder, [world], vehicle, rules, [member])
    return Flight(Trajectories(**runs.trajectories), np.array([each.numpy() for each in recorder.hidden]), world)


def _paths(ax: Axes, flight: Flight) -> None:
    """Draw the true and the believed path until the goal is reached."""
    end = _end(flight)
    arena.paint_marks(ax, circle_marks(flight.layout))
    ax.plot(*flight.paths.position[RUN][: end + 1].T, color="black", lw=1.2, zorder=4)
    ax.plot(*belief.believed(flight.paths)[RUN][:end].T, color=BELIEVED, ls="", marker="o", ms=3, mfc="none", zorder=3)
    ax.plot(*flight.paths.goal[RUN], color="black", ls="", zorder=5, **arena.SIGNS["cross"])
    arena.arena(ax, flight.layout)


def _units(ax: Axes, flight: Flight) -> None:
    """Draw the hidden units along the flight, in grey while it is in fog."""
    steps, size = flight.hidden.shape
    ax.set(xlabel="step", xlim=(0, steps))
    if not size:
        ax.text(0.5, 0.5, "no hidden state", ha="center", va="center", transform=ax.transAxes, color="0.4")
        ax.set_yticks([])
        return
    ax.imshow(
        flight.hidden.T,
        aspect="auto",
        cmap="RdBu_r",
        vmin=-1,
        vmax=1,
        interpolation="nearest",
        extent=(0, steps, size, 0),
    )
    inside = flight.paths.in_fog[RUN]
    ax.fill_between(
        np.arange(steps) + 0.5, -0.12 * size, 0, where=inside, color="#9ecae1", step="mid", lw=0, clip_on=False
    )
    if flight.paths.reached[RUN].any():
        ax.axvline(_end(flight), color="black", lw=0.8, ls="--")
    ax.set(ylim=(size, -0.12 * size), yticks=[])


def _end(flight: Flight) -> int:
    """Steps until the goal is reached, or all."""
    reached = flight.paths.reached[RUN]
    return int(reached.argmax()) + 1 if reached.any() else len(reached)


def _caption(results: Results, layout: str, flights: list[Flight], settings: ReportSettings) -> str:
    member = results.runs["member"].min()
    arrivals = [
        f"{name_of(MODEL, setting.values.get(MODEL.key, ''), settings)} "
        + (f"after {_end(flight)} steps" if flight.paths.reached[RUN].any() else "does not arrive")
        for setting, flight in zip(results.where({LAYOUT.key: layout}), flights, strict=True)
    ]
    return (
        f"The first run of member {member} with each model, until it arrives: {'; '.join(arrivals)}. Top: where the "
        "vehicle is, and where it believes to be after each step; beliefs outside the arena are not shown. Bottom: the "
        "hidden units after each step, from -1 (blue) to 1 (red); light blue above them: in fog; dashed: arrival."
    )
