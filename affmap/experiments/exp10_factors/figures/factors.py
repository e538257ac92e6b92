"""Success under each factor of variation, a panel each."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from affmap.control.settings import ControlSettings
from affmap.control.variation import FACTORS, HOME, Task
from affmap.experiments.exp10_factors.claims import KEPT
from affmap.experiments.exp10_factors.levels import AGENT, BLIND, levels, successes
from affmap.report.drawing.colors import context_color
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.setting import ReportSettings
from affmap.results.statistics import interval
from affmap.results.tables import Results

COLUMNS = 4


class Look(NamedTuple):
    """The line of an agent."""

    label: str
    color: str
    style: str
    marker: str


LOOKS: dict[int | str, Look] = {
    "oracle": Look("oracle, which knows the varied task", "black", "--", ""),
    AGENT: Look(f"agent, C = {AGENT}", context_color(AGENT), "-", "o"),
    BLIND: Look(f"agent without affordances, C = {BLIND}", context_color(BLIND), "-", "s"),
    "straight": Look("straight", "0.55", ":", ""),
}
"""Agent -> its look, in the order of the legend."""


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None where nothing is varied, or not beside home."""
    every, tables = levels(results), {agent: successes(results, agent) for agent in LOOKS}
    tables = {agent: shares for agent, shares in tables.items() if HOME in shares}
    if not every or not tables:
        return None
    rows = -(-len(every) // COLUMNS)
    figure = new_figure(1.45 * rows + 0.5)
    grid = figure.subplots(rows, COLUMNS, sharey=True, squeeze=False)
    task = home_task(results)
    for ax, (factor, variations) in zip(grid.flat, every.items(), strict=False):
        known = FACTORS[factor]
        columns = [(known.home(task), HOME), *((each.value, str(each)) for each in variations)]
        values, names = zip(*sorted(columns), strict=True)
        places = np.arange(len(values))
        for agent, shares in tables.items():
            look, own = LOOKS[agent], shares[list(names)]
            ax.plot(places, own.mean(), look.style, color=look.color, marker=look.marker, ms=3.5, lw=1.2)
            if look.marker:
                ax.vlines(places, *np.transpose([interval(own[name]) for name in names]), color=look.color, lw=1.2)
        if AGENT in tables:
            ax.axhline(KEPT * tables[AGENT][HOME].mean(), color=LOOKS[AGENT].color, lw=0.8, ls=(0, (1, 2)))
        _finish(ax, [f"{value:.3g}" for value in values], names.index(HOME), known.label, known.unit)
    for ax in grid.flat[len(every) :]:
        ax.set_axis_off()
    for ax in grid[:, 0]:
        ax.set_ylabel("success")
    shown = [LOOKS[agent] for agent in tables]
    lines = [Line2D([], [], ls=look.style, color=look.color, marker=look.marker, ms=3.5) for look in shown]
    figure.legend(lines, [look.label for look in shown], loc="outside lower center", ncols=2, frameon=False)
    return Drawn(
        figure,
        "Share of successful runs, mean over members, at each level of each factor; levels are evenly spaced. Bars: "
        f"95 % intervals over members. Dotted in green: {KEPT:g} of the agent's success at home. The shaded "
        "level, in bold, is home, where models were trained. The agents are not told of the variation.",
    )


def home_task(results: Results) -> Task:
    """The task at home: that of the first setting, whose vehicle and layout are not varied in its configuration."""
    setting = results.settings[0]
    config = results.provenance[setting.control[0]]["config"]
    layout = results.map_layout(setting)
    return Task(
        layout, results.vehicle(setting), ControlSettings.model_validate({"device": "cpu", **config["control"]})
    )


def _finish(ax: Axes, labels: list[str], home: int, title: str, unit: str) -> None:
    ax.axvspan(home - 0.3, home + 0.3, color="0.93", lw=0, zorder=0)
    ax.set(ylim=(-0.04, 1.06), yticks=[0, 0.5, 1], xlim=(-0.4, len(labels) - 0.6))
    ax.set_xticks(range(len(labels)), labels, fontsize=7)
    ax.get_xticklabels()[home].set_fontweight("bold")
    ax.set_title(f"{title} ({unit})" if unit else title, loc="left", fontsize=7.5)
