"""Moments of runs at either end of the x axis, such as the smallest and the largest context size, or three models."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from affmap.env.scene import NUM_DEVIATIONS
from affmap.report.drawing import arena
from affmap.report.drawing.colors import name_of
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results import examples, failures
from affmap.results.numbers import counted, number
from affmap.results.setting import LAYOUT, PLANNER, PLANNERS, ReportSettings, Value
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    rows = examples.rows(results)
    moments = [examples.choose_examples(results, row) for row in rows]
    columns = max(map(len, moments))
    height = 2.0 if columns > 2 else 2.55 if columns == 2 or len(rows) > 2 else 4.2
    figure = new_figure(0.7 + height * len(rows))
    grid = figure.subplots(len(rows), columns, squeeze=False)
    scenes = []
    for axes, row_moments, row in zip(grid, moments, rows, strict=True):
        for ax in axes[len(row_moments) :]:
            ax.set_axis_off()
        for ax, example in zip(axes, row_moments, strict=False):
            place = results.run_layouts(example.setting)[example.problem], results.vehicle_radius(example.setting)
            # Without throttles, whose jets are too small in print.
            scenes.append(example.paths.scene(example.problem, example.step, *place)._replace(action=None))
            arena.scene(ax, scenes[-1])
            where = f"{_row_name(results, row, settings)}, " if len(rows) > 1 else ""
            value = example.setting.values[results.x.key]
            name = name_of(results.x, value, settings) if isinstance(value, str) else f"{results.x.label} {value}"
            ax.set_title(f"{where}{name}, step {example.step}", loc="left")
    handles = arena.handles(scenes)
    columns = len(handles) if len(handles) <= 6 else -(-len(handles) // 2)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return Drawn(figure, _caption(results, settings))


def _row_name(results: Results, row: Mapping[str, Value], settings: ReportSettings) -> str:
    """Name of a row of pictures: that of its layout, or of the value shown by colour."""
    factor = LAYOUT if results.color == PLANNER else results.color
    return name_of(factor, row[factor.key], settings)


def _caption(results: Results, settings: ReportSettings) -> str:
    stories = []
    fog = any(failures.has_fog(results, job) for job in results.settings)
    rows = examples.rows(results)
    for values in rows:
        where = f"{_row_name(results, values, settings)}, " if len(rows) > 1 else ""
        for example in examples.choose_examples(results, values):
            value = name_of(results.x, example.setting.values[results.x.key], settings)
            run = _row(results, example)
            end = (
                f"reaches the goal after {run['steps_to_reach']} steps" if run["reached"] else "never reaches the goal"
            )
            in_fog = f", is in fog in {run['steps_in_fog']}" if fog else ""
            stories.append(
                f"{where}{value} (member {example.member}, run {example.run}): touches a "
                f"surface in {counted(run['steps_touching'], 'step')}{in_fog}, {end}, mean distance "
                f"{number(run['mean_distance'])} u"
            )
    noise = " Inside fog, plans start at the noisy reported position." if fog else ""
    some = ""
    if isinstance(results.x_values[0], str) and len(results.x_values) > examples.MAX_NAMES:
        some = f" Of {len(results.x_values)} values of {results.x.label}, the first and the last two are shown."
    planner = results.planners[0]
    circles = (
        f" Blue ellipses: {NUM_DEVIATIONS} standard deviations of the predicted positions along the plan."
        if results.runs["prediction_error"].notna().any()
        else ""
    )
    kind = f" with {PLANNERS[planner].method} planning" if planner in PLANNERS else f" by “{planner}”"
    kind = "" if results.x == PLANNER else kind  # each panel has its own
    return (
        f"One moment of each run{kind}. Runs were chosen by rule, not by hand: {examples.example_rule(results)}. "
        f"{'; '.join(stories)}.{circles} Numbers refer to whole runs.{noise}{some}"
    )


def _row(results: Results, example: examples.Example) -> "pd.Series[Any]":
    """Row of an example in the table of runs."""
    keys: dict[str, Value] = {"member": example.member, "run": example.run}
    keys |= {factor.column: example.setting.values[factor.key] for factor in results.factors}
    mask = np.all([results.runs[key] == value for key, value in keys.items()], axis=0)
    return results.runs[mask].iloc[0]
