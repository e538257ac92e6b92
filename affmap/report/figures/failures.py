"""Reasons and places of failed runs: a row of panels for each planner or layout."""

from collections.abc import Iterable

from matplotlib.artist import Artist
from matplotlib.axes import Axes

from affmap.env.geometry import CELL
from affmap.report.drawing import arena, numbers
from affmap.report.drawing import failures as panels
from affmap.report.drawing.colors import make_groups
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results import failures
from affmap.results.examples import MAX_ROWS
from affmap.results.numbers import listed
from affmap.results.setting import LAYOUT, PLANNER, ReportSettings
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None if runs can fail for one reason only."""
    if not failures.are_of_interest(results):
        return None
    runs = failures.with_reasons(results)
    groups = make_groups(results, settings)
    axis = groups.x, groups.x_names
    num_rows = min(MAX_ROWS, len(groups.names))
    fog = any(failures.has_fog(results, setting) for setting in results.settings)
    figure = new_figure(0.5 + 1.9 * num_rows)
    rows = figure.subplots(num_rows, 3 + fog, squeeze=False, width_ratios=(1.0, 1.15, 1.15, *[1.0] * fog))
    for (bars, middle, right, *rest), (value, name) in zip(rows, groups.names.items(), strict=False):
        panels.reasons(bars, runs[runs[groups.column] == value], *axis)
        same = {PLANNER.key: results.planners[0], LAYOUT.key: results.layouts[0], results.color.key: value}
        row = results.where({key: each for key, each in same.items() if key != results.x.key})
        row = sorted(row, key=lambda setting: results.x_values.index(setting.values[results.x.key]))
        layout = results.run_layouts(row[0])[0]
        bars.set_title(f"{name}: failed runs" if len(groups.names) > 1 else "failed runs", loc="left")
        if not results.has_own_layouts(row[0]):
            places = failures.places(results, row)
            arena.heat(middle, places.fog, layout).set_title(f"fog first entered ({len(places.fog)})", loc="left")
            arena.heat(right, places.ended, layout).set_title(f"never arrived: ends ({len(places.ended)})", loc="left")
        else:  # positions cannot be pooled if every run has its own world
            things = failures.with_nearest(results, row)
            panels.nearest(middle, things, *axis).set_title("never arrived", loc="left")
            steps = failures.step_errors(results, row)
            panels.step_errors(right, steps, *axis).set_title("errors outside fog", loc="left")
        for ax in rest:
            if any(failures.has_fog(results, setting) for setting in row):
                panels.fog_distances(ax, failures.end_distances(results, row), results.x_values, *axis)
            else:
                numbers.say(ax, "no fog in\nthese worlds").set(xticks=[], yticks=[])
            ax.set_title("distance to fog", loc="left")
    numbers.legend_below(
        figure, {"failed runs:": _entries(rows[:, 0]), "never arrived, nearest to:": _entries(rows[:, 1])}
    )
    return Drawn(figure, _caption(results, settings))


def _entries(panels: Iterable[Axes]) -> list[Artist]:
    """Legend entries of some panels, each name once."""
    entries: dict[str, Artist] = {}
    for ax in panels:
        entries |= {name: handle for handle, name in zip(*ax.get_legend_handles_labels(), strict=True)}
    return list(entries.values())


def _caption(results: Results, settings: ReportSettings) -> str:
    contexts = "above 0" if max(results.context_sizes) > 0 else "0"
    if results.has_own_layouts():
        others = (
            "Second: runs that never arrived, in fog or not, by the object that the vehicle was nearest to, or deepest "
            "inside, at the end. Third: median prediction error of single steps, by the number of circles acting on "
            "the vehicle (never more than one in training); steps in fog are excluded, because positions reported "
            "there are noisy."
        )
    else:
        others = (
            f"Second and third: where runs with a context size {contexts} first entered fog, and where runs that "
            "never arrived ended (numbers of runs in brackets; a run may be in both), as points or, if there are many, "
            f"as runs per cell of {CELL} u."
        )
    if any(failures.has_fog(results, job) for job in results.settings):
        others += " Last: distance to fog at the end of runs that never arrived (u; dashed: edge of fog)."
    names = make_groups(results, settings).names.values()
    some = f" Rows: {listed(list(names)[:MAX_ROWS])} only." if len(names) > MAX_ROWS else ""
    return (
        "Left: share of failed runs, by reason. A run that entered fog counts as such, whether or not it arrived; "
        "stuck: in the last quarter of the run the vehicle stays within one diameter of its mean position. "
        f"{others}{some} The paper does not report these results."
    )
