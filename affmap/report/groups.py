"""What colours tell apart in a report, planners or layouts, and what they are called."""

from typing import NamedTuple

import pandas as pd

from affmap.report.settings import ReportSettings
from affmap.report.tables import Results
from affmap.settings import ConfigError

PLANNER_COLORS = {"cem": "#0072B2", "gradient": "#E69F00"}  # Okabe and Ito: told apart by everybody, and in grey
LAYOUT_COLORS = ("#44AA99", "#882255", "#DDCC77", "#332288", "#88CCEE", "#999933")  # Tol: the same, in their order


class Groups(NamedTuple):
    """The values of one column of the runs, with names and colours."""

    column: str
    """`planner` or `layout`."""
    names: dict[str, str]
    """Value -> what readers call it, in the order of the report."""
    palette: dict[str, str]
    """Name -> colour."""

    def of(self, table: pd.DataFrame) -> "pd.Series[str]":
        """The names of the rows of `table`."""
        return table[self.column].map(self.names)


def make_groups(results: Results, settings: ReportSettings) -> Groups:
    """What the colours of a report tell apart.

    Raises:
        ConfigError: settings that differ in something else would end in the same box.
    """
    values = {"planner": results.planners, "layout": results.layouts}
    other = next(column for column in values if column != settings.color)
    if len(values[other]) > 1:
        raise ConfigError(
            f"report.color is {settings.color!r}, but these jobs differ in their {other} ({', '.join(values[other])}); "
            f"say report.color={other}, or run one {other} only."
        )
    names = {value: readable(value, settings) for value in values[settings.color]}
    layouts = dict(zip(results.layouts, LAYOUT_COLORS * len(results.layouts), strict=False))
    colors = PLANNER_COLORS if settings.color == "planner" else layouts
    return Groups(settings.color, names, {name: colors[value] for value, name in names.items()})


def readable(value: str, settings: ReportSettings) -> str:
    """What readers call a planner or a layout."""
    return settings.names.get(value, value.replace("_", " "))
