"""Reasons for errors of beliefs and for few arrivals: noise of reports in beliefs, speeds in fog, and walls passed."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from affmap.env.layout import Layout
from affmap.experiments.exp9.claims import MODEL
from affmap.experiments.exp9.tracking import Tracks, track
from affmap.report.drawing.colors import group_colors, name_of, readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results import belief, statistics
from affmap.results.files import Floats, Trajectories
from affmap.results.numbers import number
from affmap.results.setting import LAYOUT, ReportSettings, Setting
from affmap.results.tables import Results
from affmap.threads import limited

SIGNS = (("o", "-"), ("D", "--"))
"""Markers and lines of the layouts, in turn."""

BOUND = "filter (knows the physics)"
BOUND_LOOK: dict[str, Any] = {"color": "black", "ls": ":", "lw": 1.1}


class Series(NamedTuple):
    """A model in a layout, as it is drawn."""

    setting: Setting
    name: str
    color: str
    marker: str
    line: str


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    values = list(dict.fromkeys(each.values.get(MODEL.key, "") for each in results.settings))
    names = {value: name_of(MODEL, value, settings) for value in values}
    colors = group_colors(names)
    signs = {layout: SIGNS[number % len(SIGNS)] for number, layout in enumerate(results.layouts)}
    models = [
        Series(setting, name, colors[name], *signs[layout])
        for value, name in names.items()
        for layout in results.layouts
        for setting in results.where({LAYOUT.key: layout})
        if setting.values.get(MODEL.key, "") == value
    ]
    filters = [setting for setting in results.baselines if setting.planner == "filter"]
    with limited(1):
        tracks = [track(results, each.setting) for each in models]
    figure = new_figure(2.6)
    beliefs, speeds, walls = figure.subplots(1, 3, width_ratios=[1.3, 1, 1])
    _beliefs(beliefs, models, tracks, results.vehicle(models[0].setting).fog_std)
    _speeds(speeds, models, results, filters)
    _walls(walls, models, results, filters)
    handles: list[Artist] = [Line2D([], [], color=color, lw=1.5, label=name) for name, color in colors.items()]
    for layout, (marker, line) in signs.items():
        handles.append(Line2D([], [], color="0.3", ls=line, marker=marker, ms=3, label=readable(layout, settings)))
    if filters:
        handles.append(Line2D([], [], **BOUND_LOOK, label=BOUND))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, columnspacing=1.2)
    return Drawn(figure, _caption(models, tracks, [readable(layout, settings) for layout in results.layouts]))


def passed(paths: Trajectories, layout: Layout) -> Floats:
    """Whether runs get past each wall, in the order of their way, and to the goal: `[B, walls + 1]`, 0 or 1.

    A wall is a row of obstacles at one x; a vehicle whose centre is beyond all of them is past it.
    """
    walls = sorted({(circle.x, circle.radius) for circle in layout.obstacles})
    ahead = np.sign(paths.goal[:, :1] - paths.position[:, 0, :1])  # [B, 1]
    way = ahead * paths.position[..., 0]
    beyond = [(way > ahead * x + radius).any(1) for x, radius in walls]
    columns = np.array(beyond, bool).reshape(len(walls), len(way)).T
    return np.column_stack([np.where(ahead > 0, columns, columns[:, ::-1]), paths.reached.any(1)]).astype(float)


def _beliefs(ax: Axes, models: Sequence[Series], tracks: Sequence[Tracks], noise_std: float) -> None:
    """Draw the error of each member's belief over the noise of reports that is in it."""
    gains = np.linspace(0, 1, 101)
    ax.plot(gains, belief.filter_error(gains, noise_std), color="0.5", lw=1.0, zorder=0)
    for model, each in zip(models, tracks, strict=True):
        ax.plot(_shares(each), _errors(each), ls="", marker=model.marker, ms=3, mfc="none", color=model.color)
    ax.set(xlabel="noise of the last report\nin the belief (share)", ylabel="error of the belief (u)")
    ax.set(xlim=(0, 1), ylim=(0, None))
    ax.set_title("A  Belief", loc="left")


def _speeds(ax: Axes, models: Sequence[Series], results: Results, filters: Sequence[Setting]) -> None:
    """Draw mean speeds in fog, with intervals where there are enough members."""
    names, seen = list(dict.fromkeys(model.name for model in models)), dict.fromkeys(model.marker for model in models)
    for model in models:
        place = names.index(model.name) + 0.3 * ([*seen].index(model.marker) - (len(seen) - 1) / 2)
        speeds = belief.speeds_in_fog(results.trajectories(model.setting))
        speeds = speeds[np.isfinite(speeds)]
        if len(speeds) >= statistics.MIN_MEMBERS:
            ax.vlines(place, *statistics.interval(speeds), color=model.color, lw=1.0)
        if len(speeds):
            ax.plot(place, speeds.mean(), ls="", marker=model.marker, ms=4, color=model.color)
    for setting in filters:
        ax.axhline(belief.speeds_in_fog(results.trajectories(setting)).mean(), **BOUND_LOOK)
    ax.set(ylabel="speed in fog (u/step)", xlim=(-0.6, len(names) - 0.4), ylim=(0, None))
    ax.set_xticks(range(len(names)), names)
    ax.set_title("B  Speed", loc="left")


def _walls(ax: Axes, models: Sequence[Series], results: Results, filters: Sequence[Setting]) -> None:
    """Draw the shares of runs that get past walls, and to the goal."""

    def shares(setting: Setting) -> Floats:
        return np.asarray(passed(results.trajectories(setting), results.run_layouts(setting)[0]).mean(0))

    for setting in filters:
        ax.plot(shares(setting), **BOUND_LOOK)
    for model in models:
        ax.plot(shares(model.setting), color=model.color, ls=model.line, lw=1.2, marker=model.marker, ms=3)
    walls = len(shares(models[0].setting)) - 1
    ax.set_xticks(range(walls + 1), [*(f"wall {wall + 1}" for wall in range(walls)), "goal"])
    ax.set(ylabel="share of runs", ylim=(0, 1.05))
    ax.set_title("C  Past walls", loc="left")


def _shares(tracks: Tracks) -> Floats:
    """Share of the last report's noise in the belief of each member, `[M]`."""
    return belief.noise_share(tracks.errors, tracks.noise)


def _errors(tracks: Tracks) -> Floats:
    """Root mean square error of the belief of each member, `[M]` in u; NaN without a step."""
    squares = np.square(tracks.errors).sum(-1)
    return np.sqrt(squares.mean(1)) if squares.size else np.full(len(squares), np.nan)


def _caption(models: Sequence[Series], tracks: Sequence[Tracks], layouts: Sequence[str]) -> str:
    def means(score: Callable[[Tracks], Floats]) -> str:
        """The mean over members of a score of each model, by layout."""
        cells: dict[str, list[str]] = {}
        for model, each in zip(models, tracks, strict=True):
            cells.setdefault(model.name, []).append(number(float(score(each).mean())))
        return ", ".join(f"{name} {' / '.join(texts)}" for name, texts in cells.items())

    by_layout = f" ({' / '.join(layouts)})" if len(layouts) > 1 else ""
    return (
        "(A) Beliefs in exploration that training did not see, after steps that begin and end in fog, a sign for each "
        "member: root mean square error, and the share of the last report's noise in the belief, by least squares. "
        "Line: a filter that knows each step and moves its belief by this share of the way to each report; best is 0. "
        f"Means over members{by_layout}: share {means(_shares)}; error {means(_errors)} u; where nothing was touched "
        f"since the vehicle entered fog, {means(lambda each: _errors(each.clear))} u. (B) Mean length of steps that "
        "end in fog, in control, with 95 % intervals over members. (C) Share of runs of control that get beyond the "
        "posts of the first and of the second wall, and to the goal."
    )
