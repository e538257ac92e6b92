"""Outcomes of runs: arrivals, contact, and the distance if success is measured otherwise."""

from affmap.report.drawing import numbers
from affmap.report.drawing.colors import make_groups, name_of
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.metrics import METRICS, extra_metrics
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure, which the paper does not have."""
    groups = make_groups(results, settings)
    more = _metrics(settings)
    figure = new_figure(2.6 * -(-(2 + len(more)) // 3))
    share, touching, *others = figure.subplots(-(-(2 + len(more)) // 3), min(3, 2 + len(more)), squeeze=False).ravel()
    numbers.titled(numbers.bars(share, results.runs, "reached", groups, intervals=True), "A  Arrivals")
    numbers.titled(numbers.boxes(touching, results.runs, "steps_touching", groups), "B  Contact")
    for letter, ax, metric in zip("CDEFGHIJKLMNOPQRSTUVWXYZ", others, more, strict=False):
        numbers.titled(numbers.boxes(ax, results.runs, metric, groups), numbers.panel_title(letter, metric))
    for ax in others[len(more) :]:
        ax.set_axis_off()
    for ax in (share, touching, *others[: len(more)]):
        numbers.turn_names(ax, groups.x_names.values())
    panels = {"reached": share, "steps_touching": touching, **dict(zip(more, others, strict=False))}
    numbers.baseline_lines(figure, panels, results.baseline_runs, groups)
    return Drawn(figure, _caption(results, settings))


def _metrics(settings: ReportSettings) -> list[str]:
    """Further metrics beside arrivals and contact.

    The distance if success is measured otherwise, and all metrics that reports show in addition.
    """
    return [*(["mean_distance"] if settings.outcome != "mean_distance" else []), *extra_metrics()]


def _caption(results: Results, settings: ReportSettings) -> str:
    groups = make_groups(results, settings)
    shares = results.runs.groupby([groups.column, results.x.column], sort=False)["reached"].mean()
    parts = []
    for value, name in groups.names.items():
        values = shares[value]
        first, last = values.index[0], values.index[-1]
        ends = [f"{values[value]:.0%} of the runs at {name_of(results.x, value, settings)}" for value in (first, last)]
        parts.append(f"{name} {' and '.join(dict.fromkeys(ends))}")
    letters = zip("CDEFGHIJKLMNOPQRSTUVWXYZ", _metrics(settings), strict=False)
    more = "".join(f" ({letter}) {METRICS[metric].label.capitalize()}." for letter, metric in letters)
    return (
        "(A) Share of runs that reached the goal, regardless of contact, with 95 % bootstrap intervals over members: "
        f"{'; '.join(parts)}. (B) Number of steps per run in contact with an obstacle or a border.{more} The paper "
        "does not report these results."
    )
