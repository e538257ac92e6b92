"""Validation losses by kind of step."""

from affmap.report.drawing import losses
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.files import EVERYWHERE, KINDS
from affmap.results.setting import LAYOUT, ReportSettings
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption losses at the end of training, and the contribution of each kind of step over epochs."""
    table = results.steps[results.steps["world"] == EVERYWHERE]
    factor = results.training_factor
    first = table[table[LAYOUT.column] == table[LAYOUT.column].iloc[-1]]  # of the layout that an experiment is about
    last = first[first["epoch"] == first["epoch"].max()]
    kinds = [kind for kind in KINDS if kind in set(last["kind"])]
    values = list(dict.fromkeys(last[factor.column]))
    examples = list(dict.fromkeys([values[0], values[len(values) // 2], values[-1]]))
    several = first["epoch"].nunique() > 1
    figure = new_figure(2.3 * (1 + several))
    grid = figure.add_gridspec(1 + several, 1)
    top = grid[0].subgridspec(1, len(kinds)).subplots(squeeze=False)[0]
    for ax, kind in zip(top, kinds, strict=True):
        losses.step_losses(ax, last, kind, factor).set_title(kind, loc="left")
    top[0].set_ylabel("loss of a step (nats)")
    figure.legend(*top[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    if several:
        bottom = grid[1].subgridspec(1, len(examples)).subplots(squeeze=False)[0]
        for ax, value in zip(bottom, examples, strict=True):
            losses.contributions(ax, first[first[factor.column] == value], kinds)
            ax.set_title(factor.format(value), loc="left")
        bottom[0].set_ylabel("part of the mean loss (nats)")
        bottom[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, handlelength=0.9)
    return Drawn(
        figure,
        "Validation losses by kind of step. Top: the median step and the mean of all steps at the end of training "
        "(points: median over members; lines: quartiles). Bottom: contribution of each kind of step to the mean loss "
        "in the course of training, and their sum (dotted); medians over members, at the epochs whose weights were "
        "kept.",
    )
