"""Validation losses by kind of step."""

from affmap.report.drawing import losses
from affmap.report.drawing.colors import Groups, make_groups, name_of
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.examples import MAX_ROWS
from affmap.results.files import EVERYWHERE, KINDS
from affmap.results.numbers import listed
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption losses at the end of training, and the contribution of each kind of step over epochs."""
    steps = results.steps[results.steps["world"] == EVERYWHERE]
    last = steps[steps["epoch"] == steps.groupby(results.trainings)["epoch"].transform("max")]
    kinds = [kind for kind in KINDS if kind in set(last["kind"])]
    factor, names = results.training_factor, make_groups(results, settings).x_names
    groups = _trained_groups(results, settings)
    rows = {"": steps}
    if groups:
        of_group = groups.of(steps)
        rows = {f"{name}, ": steps[of_group == name] for name in list(groups.names.values())[:MAX_ROWS]}
    rows = rows if steps["epoch"].nunique() > 1 else {}
    heights = [2.3, *[2.3 if len(rows) == 1 else 1.9] * len(rows)]
    figure = new_figure(sum(heights))
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    top = grid[0].subgridspec(1, len(kinds)).subplots(squeeze=False)[0]
    for ax, kind in zip(top, kinds, strict=True):
        losses.step_losses(ax, last, kind, factor, names, groups).set_title(kind, loc="left")
    top[0].set_ylabel("loss of a step (nats)")
    handles = losses.step_handles(groups)
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles), frameon=False)
    values = losses.in_order(last[factor.column], names)
    examples = list(dict.fromkeys([values[0], values[len(values) // 2], values[-1]]))
    for cell, (prefix, of_row) in zip(range(1, len(heights)), rows.items(), strict=True):
        bottom = grid[cell].subgridspec(1, len(examples)).subplots(squeeze=False)[0]
        for ax, value in zip(bottom, examples, strict=True):
            losses.contributions(ax, of_row[of_row[factor.column] == value], kinds)
            ax.set_title(f"{prefix}{name_of(factor, value, settings)}", loc="left")
        bottom[0].set_ylabel("part of the mean loss (nats)")
        bottom[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, handlelength=0.9)
    return Drawn(figure, _caption(groups, over_epochs=bool(rows)))


def _trained_groups(results: Results, settings: ReportSettings) -> Groups | None:
    """Groups of trainings that differ in the value shown by colour; None if those of one value on the x axis do not."""
    groups = make_groups(results, settings)
    if results.color.column not in results.trainings or results.color == results.training_factor:
        return None
    trained = set(results.steps[groups.column])
    names = {value: name for value, name in groups.names.items() if value in trained}
    palette = {name: groups.palette[name] for name in names.values()}
    return groups._replace(names=names, palette=palette) if len(names) > 1 else None


def _caption(groups: Groups | None, over_epochs: bool) -> str:
    names = list(groups.names.values()) if groups else []
    some = f"; of {listed(names[:MAX_ROWS])} only" if len(names) > MAX_ROWS else ""
    colors = f", {listed(names)} in colours of their own" if names else ""
    last = (
        "the median step and the mean of all steps at the end of training (points: median over members; lines: "
        f"quartiles){colors}."
    )
    if not over_epochs:
        return f"Validation losses by kind of step: {last}"
    return (
        f"Validation losses by kind of step. Top: {last} Bottom: contribution of each kind of step to the mean loss in "
        "the course of training, and their sum (dotted); medians over members, at the epochs whose weights were "
        f"kept{some}."
    )
