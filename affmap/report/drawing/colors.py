"""What colours tell apart in a report, planners or layouts, and what they are called."""

from typing import NamedTuple

import pandas as pd

from affmap.results.setting import ReportSettings
from affmap.results.tables import Results
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
    """What the colours of a report tell apart: layouts where there are several, else planners.

    Raises:
        ConfigError: there are several of both, and some would end in the same box.
    """
    planners, layouts = results.planners, results.layouts
    if len(planners) > 1 and len(layouts) > 1:
        raise ConfigError(
            f"a report tells either planners or layouts apart, and here are several of both ({', '.join(planners)}; "
            f"{', '.join(layouts)}); say planner={planners[0]} or control_layout={layouts[0]}, with output=runs/<name>."
        )
    several = len(layouts) > 1
    names = {value: readable(value, settings) for value in (layouts if several else planners)}
    values = layouts if several else [planner for planner in planners if planner not in PLANNER_COLORS]
    colors = PLANNER_COLORS | dict(zip(values, LAYOUT_COLORS * len(values), strict=False))
    return Groups("layout" if several else "planner", names, {name: colors[value] for value, name in names.items()})


def readable(value: str, settings: ReportSettings) -> str:
    """What readers call a planner or a layout."""
    return settings.names.get(value, value.replace("_", " "))
