"""A memorised map before and after an obstacle has moved, and the errors of all maps over time."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from affmap.experiments.exp9_map.claims import EMPTY, EXPLORED, MEMORY, MOVED, OUTDATED, REPAIRED, Memories
from affmap.model.palette import Palette
from affmap.report.drawing import arena
from affmap.report.drawing.colors import NAME_COLORS
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.files import Recall
from affmap.results.setting import LAYOUT, ReportSettings
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption maps of the first member, and mean errors of the members' maps."""
    figure = new_figure(4.6)
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    upper, lower = parts
    memories, panels = Memories(results), upper.subplots(1, 3, sharey=True)
    if recall := memories.recall(REPAIRED, MOVED):
        _maps(panels, recall, results)
    ax = lower.subplots()
    for number, memory in enumerate((EXPLORED, OUTDATED, REPAIRED, EMPTY)):
        if other := memories.recall(memory, MOVED):
            _errors(ax, other, NAME_COLORS[number], settings.names.get(memory, memory))
    ax.set(xlabel="steps in the world", ylabel="error of the codes", ylim=(0, None))
    ax.legend(frameon=False, ncols=4, loc="lower right", bbox_to_anchor=(1, 1))
    return Drawn(
        figure,
        "Above: codes as colours (their principal components) of the first member after an obstacle has moved: the "
        "true ones, also inside obstacles; those that it remembers from the world before; and those at the end of that "
        "of its runs, here with its path, after which the error is smallest. Below: error of the codes in memory, as a "
        "share of the true ones, at the free places whose views have changed (or at all free places, where the agent "
        "has explored this world or nothing); means over members, and middle half of them. Repaired maps have flown "
        "another flight before their runs; the dashed line is between both.",
    )


def _maps(panels: np.ndarray, recall: Recall, results: Results) -> None:
    """Draw the true map, and those in memory before and after."""
    (setting,) = results.where({MEMORY.key: REPAIRED, LAYOUT.key: MOVED})
    paths, layout = results.trajectories(setting), results.run_layouts(setting)[0]
    palette = Palette.fit(recall.true.reshape(-1, recall.true.shape[-1]))
    titles = {"true": recall.true, "remembered": recall.at_first, "repaired": recall.at_last}
    for ax, (title, codes) in zip(panels, titles.items(), strict=True):
        arena.affordance_map(ax, palette(codes), recall.x, recall.y, layout.map)
        ax.set_title(title, loc="left")
    panels[2].plot(*paths.position[recall.best].T, color="black", lw=0.9)
    for ax in panels[1:]:
        ax.set_ylabel("")


def _errors(ax: Axes, recall: Recall, color: str, name: str) -> None:
    """Draw the mean error of the members at each step, and where the middle half of them are."""
    errors = np.array([recall.error[recall.member == member].mean(0) for member in np.unique(recall.member)])
    steps = np.arange(errors.shape[1])
    ax.plot(steps, errors.mean(0), color=color, lw=1.3, label=name)
    ax.fill_between(steps, *np.quantile(errors, (0.25, 0.75), axis=0), color=color, alpha=0.15, lw=0)
    if recall.earlier:
        ax.axvline(float(recall.earlier), color=color, lw=0.8, ls="--")
