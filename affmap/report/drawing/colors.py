"""The grouping variable of a report, its labels and colours."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.colors import to_hex

from affmap.results.setting import CONTEXT_SIZE, PLANNERS, Factor, ReportSettings, Value, reader_name
from affmap.results.tables import Results

GROUP_COLORS = ("#44AA99", "#882255", "#DDCC77", "#332288", "#88CCEE", "#999933")  # Tol; distinguishable in this order


NAME_COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")  # Okabe and Ito's
"""Of curves of names on the x axis; other ones than those of groups, which stand beside them."""

NUMBERS: Mapping[Value, str] = MappingProxyType({})
"""Names of values on an axis that are numbers, and need none."""


class Groups(NamedTuple):
    """Values of the grouping variable, with names and colours, and the factor on the x axis."""

    column: str
    """Column of the grouping variable in the table of runs."""
    names: dict[Value, str]
    """Value -> its name for readers, in the order of the report."""
    palette: dict[str, str]
    """Name -> colour."""
    x: Factor = CONTEXT_SIZE
    x_names: Mapping[Value, str] = NUMBERS
    """Value on the x axis -> its name for readers; empty for numbers."""

    def of(self, table: pd.DataFrame) -> "pd.Series[str]":
        """Group names of the rows of `table`."""
        return table[self.column].map(self.names)

    def x_of(self, table: pd.DataFrame) -> "pd.Series[Any]":
        """Positions of the rows of `table` on the x axis."""
        return table[self.x.column].map(self.x_names) if self.x_names else table[self.x.column]


def make_groups(results: Results, settings: ReportSettings) -> Groups:
    """Groups of a report's runs, by the values of its second factor."""
    factor, values = results.color, results.color_values
    names = names_of(factor, values, settings)
    x, x_values = results.x, results.x_values
    x_names = names_of(x, x_values, settings) if isinstance(x_values[0], str) else {}
    return Groups(factor.column, names, group_colors(names), x, x_names)


def group_colors(names: Mapping[Value, str]) -> dict[str, str]:
    """Name -> colour, for the names of the values of a grouping variable; planners have colours of their own."""
    own = {kind: planner.color for kind, planner in PLANNERS.items()}
    others = [value for value in names if value not in own]
    palette = GROUP_COLORS if len(others) <= len(GROUP_COLORS) else sns.husl_palette(len(others)).as_hex()
    colors = own | dict(zip(others, palette, strict=False))
    return {name: colors[value] for value, name in names.items()}


def name_of(factor: Factor, value: Value, settings: ReportSettings) -> str:
    """Name of a value for readers: that of the settings for planners and layouts, else the value with its symbol."""
    return settings.names.get(str(value), factor.format(value))


def names_of(factor: Factor, values: Iterable[Value], settings: ReportSettings) -> dict[Value, str]:
    """Names of values for readers, see `name_of`; beside a name of the settings, another one lacks the symbol, too."""
    values = list(values)
    named = any(str(value) in settings.names for value in values)
    return {
        value: readable(value, settings) if named and isinstance(value, str) else name_of(factor, value, settings)
        for value in values
    }


def readable(value: str, settings: ReportSettings) -> str:
    """Name of a planner or a layout for readers."""
    return reader_name(value, settings.names)


def x_colors(factor: Factor, values: Iterable[Value]) -> dict[Value, str]:
    """Value on the x axis -> colour of its curve; context sizes have the same colours in every report.

    Numbers have the colours of a scale, and names distinct ones, as far as these go.
    """
    values = list(values)
    if factor == CONTEXT_SIZE:
        return {value: context_color(int(value)) for value in values}
    if isinstance(values[0], str) and len(values) <= len(NAME_COLORS):
        return dict(zip(values, NAME_COLORS, strict=False))
    places = np.linspace(0.0, 0.9, len(values))
    return {value: to_hex(mpl.colormaps["viridis"](place)) for value, place in zip(values, places, strict=True)}


def context_color(context_size: int) -> str:
    """Colour of a context size, the same in every report."""
    position = np.interp(context_size, [0, 1, 3, 5, 8, 16, 32], [0.0, 0.2, 0.4, 0.58, 0.75, 0.88, 1.0])
    return to_hex(mpl.colormaps["viridis"](position))
