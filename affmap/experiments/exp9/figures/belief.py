"""Error of the believed position by the number of steps in fog."""

import numpy as np
from matplotlib.axes import Axes

from affmap.experiments.exp9.claims import MODEL, NEAR, STEPS
from affmap.report.drawing.colors import group_colors, name_of, readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results import belief
from affmap.results.files import Trajectories
from affmap.results.setting import LAYOUT, ReportSettings
from affmap.results.tables import Results

LONGEST = 30
"""Steps into fog that are shown."""

SMALLEST = 1e-4
"""u; smaller errors are drawn there."""

FEWEST = 5
"""Moments, over all runs, of which an error is shown."""


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the errors of all models and of the filter, a panel for each layout."""
    figure = new_figure(2.4)
    axes = figure.subplots(1, len(results.layouts), sharey=True, squeeze=False)[0]
    values = list(dict.fromkeys(each.values.get(MODEL.key, "") for each in results.settings))
    names = {value: name_of(MODEL, value, settings) for value in values}
    colors = group_colors(names)
    for ax, layout in zip(axes, results.layouts, strict=True):
        for setting in results.where({LAYOUT.key: layout}):
            name = names[setting.values.get(MODEL.key, "")]
            _curve(ax, results.trajectories(setting), colors[name], name)
        for setting in results.baselines:
            if setting.planner == "filter" and setting.layout == layout:
                _curve(ax, results.trajectories(setting), "black", "filter (knows the physics)")
        ax.axhline(NEAR, color="0.6", lw=0.8, ls="--")
        ax.axvline(STEPS, color="0.6", lw=0.8, ls="--")
        ax.set(yscale="log", xlabel="steps in fog", xlim=(0, LONGEST + 1))
        ax.set_title(readable(layout, settings), loc="left")
    axes[0].set_ylabel("error of the belief (u)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return Drawn(
        figure,
        "Distance between believed and true position by the number of steps since the vehicle entered fog, root of the "
        "mean square over all runs. Who believes a report is off by 1.41 u. Dashed: the goal, less than "
        f"{NEAR:g} u after {STEPS} steps. Runs that have left the fog no longer count, so that those that are lost "
        "weigh more and more. Errors below "
        f"{SMALLEST:g} u are drawn there.",
    )


def _curve(ax: Axes, paths: Trajectories, color: str, name: str) -> None:
    """Draw the errors of one agent, by steps in fog."""
    squares, since = belief.errors(paths) ** 2, belief.steps_in_fog(paths)
    steps = [step for step in range(1, LONGEST + 1) if (since == step).sum() >= FEWEST]
    errors = [np.sqrt(squares[since == step].mean()) for step in steps]
    ax.plot(steps, np.maximum(errors, SMALLEST), color=color, lw=1.3, label=name)
