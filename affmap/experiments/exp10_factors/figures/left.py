"""How much of the success at home is left at each level of each factor, as a table in colours."""

from collections.abc import Sequence
from itertools import takewhile

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from affmap.control.variation import FACTORS, HOME, Task, Variation
from affmap.experiments.exp10_factors.claims import KEPT, at_home, keeps_at
from affmap.experiments.exp10_factors.figures.factors import home_task
from affmap.experiments.exp10_factors.levels import AGENT, left, levels, successes, value_name
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.numbers import number
from affmap.results.setting import ReportSettings
from affmap.results.statistics import Verdict
from affmap.results.tables import Results

GAP = 0.5
"""Width of the place of home in a row, in cells."""


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the table; None without the agent's runs at home and elsewhere."""
    every, shares, oracle = levels(results), successes(results, AGENT), successes(results, "oracle")
    if not every or HOME not in shares:
        return None
    task, most = home_task(results), max(map(len, every.values()))
    figure = new_figure(0.34 * len(every) + 0.5)
    ax = figure.subplots()
    for row, (factor, variations) in enumerate(every.items()):
        _row(ax, row, variations, shares, oracle, FACTORS[factor].home(task))
        kept = _kept(shares, variations, task)
        ax.text(most + GAP + 0.1, row, kept, va="center", fontsize=7)
    for x, text in (
        (0.0, "levels, from small to large, and home (black)"),
        (most + GAP + 0.1, f"at least {KEPT:g} left"),
    ):
        ax.text(x, -0.75, text, va="center", fontsize=7, color="0.35")
    ax.set_yticks(range(len(every)), [FACTORS[factor].label for factor in every])
    ax.set(xlim=(0, most + GAP + 1.6), ylim=(len(every) - 0.45, -1.1), xticks=[])
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    return Drawn(figure, _caption(not oracle.empty))


def _row(
    ax: Axes, row: int, variations: Sequence[Variation], shares: pd.DataFrame, oracle: pd.DataFrame, home: float
) -> None:
    """Draw the cells of a factor, and its home between them."""
    x = 0.0
    below = [each for each in variations if each.value < home]
    for place, level in enumerate(variations):
        if place == len(below):
            x += GAP
        share = left(shares, level, shares[HOME])
        color = mpl.colormaps["RdYlBu"](0.15 + 0.6 * min(share, 1))
        ax.add_patch(Rectangle((x + 0.02, row - 0.45), 0.96, 0.9, color=color, lw=0))
        bound = f" ({number(left(oracle, level, oracle[HOME]))})" if str(level) in oracle and HOME in oracle else ""
        ax.text(x + 0.5, row - 0.2, value_name(level), ha="center", va="center", fontsize=6, color="0.25")
        ax.text(x + 0.5, row + 0.17, f"{number(share)}{bound}", ha="center", va="center", fontsize=7)
        x += 1
    at = len(below) + GAP / 2
    ax.add_patch(Rectangle((at - 0.03, row - 0.45), 0.06, 0.9, color="black", lw=0))


def _kept(shares: pd.DataFrame, variations: Sequence[Variation], task: Task) -> str:
    """The range around home whose levels are all kept, by their intervals."""
    factor = FACTORS[variations[0].factor]
    home = factor.home(task)
    held = {each.value: keeps_at(shares, each, at_home(shares)).verdict is Verdict.HOLDS for each in variations}
    below, above = [value for value in held if value < home], [value for value in held if value > home]
    low, high = ([home, *takewhile(held.__getitem__, side)][-1] for side in (reversed(below), above))
    return f"{low:.3g} to {high:.3g} {factor.unit}".strip() if low < high else "at home only"


def _caption(with_oracle: bool) -> str:
    beside = "; in brackets that of the oracle, of its own success at home" if with_oracle else ""
    return (
        f"The success of the agent (C = {AGENT}) at each level, as a share of its success at home{beside}. Right: the "
        f"range around home at whose levels at least {KEPT:g} is left, by the 95 % interval over members."
    )
