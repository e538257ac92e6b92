"""Plots of tables: numbers by hand, and the tables of a published report."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

import affmap
from affmap.report.drawing.colors import GROUP_COLORS, context_color
from affmap.settings import ConfigError

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "runs/reference/exp1"


def axes() -> Axes:
    return Figure().subplots()


def make_losses() -> pd.DataFrame:
    """Two members at context sizes 1 and 8, for two epochs: -(size + epoch) nats, and 2 nats more for member 1."""
    rows = [(size, member, epoch) for size in (1, 8) for member in (0, 1) for epoch in (1, 2)]
    table = pd.DataFrame(rows, columns=["context_size", "member", "epoch"])
    return table.assign(validation_nll=2.0 * table["member"] - table["context_size"] - table["epoch"])


def make_runs() -> pd.DataFrame:
    """Distances 1 to 5 u of agent a, ten times as much of agent b, at context sizes 0 and 8; odd runs have arrived."""
    rows = [
        (agent, size, member, factor * (member + 1) + size, bool(member % 2))
        for agent, factor in (("my_b", 10.0), ("a", 1.0))
        for size in (8, 0)
        for member in range(5)
    ]
    return pd.DataFrame(rows, columns=["agent", "context_size", "member", "mean_distance", "reached"])


def medians(ax: Axes) -> list[float]:
    """Medians of the boxes, from left to right."""
    boxes = [np.asarray(patch.get_path().vertices) for patch in ax.patches if isinstance(patch, PathPatch)]
    lines = {tuple(line.get_xdata()): line.get_ydata() for line in ax.lines if line.get_linewidth() == 1.6}
    middles = sorted((np.mean(x), y[0]) for x, y in lines.items())
    assert len(middles) == len(boxes)
    return [float(y) for _, y in middles]


def texts(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    return [text.get_text() for text in legend.get_texts()] if legend else []


def test_curves_are_means_over_members() -> None:
    """By hand: -1 and -2 nats at size 1, seven less at size 8; in the colours of reports."""
    ax = affmap.plot.losses(make_losses(), ax=axes())
    curves = [line for line in ax.lines if len(line.get_xdata()) == 2]
    assert [list(line.get_ydata()) for line in curves] == [[-1, -2], [-8, -9]] and texts(ax) == ["1", "8"]
    assert [to_hex(line.get_color()) for line in curves] == [context_color(1), context_color(8)]
    assert ax.get_ylabel() == "validation NLL (nats)" and ax.get_title("left") == "Loss by context size"


def test_curves_may_stand_for_words_or_for_one_training() -> None:
    """Two layouts with their names for readers, in the order of the table; and a table without any group."""
    table = make_losses().assign(layout=["two_obstacles"] * 4 + ["fog"] * 4)
    ax = affmap.plot.losses(table, by="layout", ax=axes())
    assert texts(ax) == ["two obstacles", "fog"]
    assert [to_hex(line.get_color()).upper() for line in ax.get_legend().get_lines()] == [*GROUP_COLORS[:2]]
    one = make_losses()[["member", "epoch", "validation_nll"]][:4]
    for ax in (affmap.plot.losses(one, by=None, ax=axes()), affmap.plot.losses(one, ax=axes())):
        assert [list(line.get_ydata()) for line in ax.lines if len(line.get_xdata()) == 2] == [[-1, -2]]
        assert texts(ax) == [] and ax.get_title("left") == ""


def test_a_curve_never_mixes_trainings() -> None:
    """One of each layout: the mean over both would be that of no training."""
    table = pd.concat([make_losses().assign(layout=layout) for layout in ("original", "fog")])
    with pytest.raises(ConfigError, match=r"several losses .* context_size; .* choose the rows of one layout first"):
        affmap.plot.losses(table)
    with pytest.raises(ConfigError, match="choose the rows of one context_size first"):
        affmap.plot.losses(make_losses(), by=None)


def test_tables_come_from_reports() -> None:
    """A folder, a name and the table itself: the same curves and boxes."""
    validation, runs = (pd.read_csv(REPORT / "tables" / f"{name}.csv") for name in ("validation", "runs"))
    drawn = [affmap.plot.losses(table, ax=axes()) for table in (validation, REPORT, str(REPORT), "exp1")]
    curves = [[list(line.get_ydata()) for line in ax.lines] for ax in drawn]
    assert len(curves[0]) >= 5 and all(each == curves[0] for each in curves)
    own, named = (affmap.plot.boxes(table, "mean_distance", color="planner", ax=axes()) for table in (runs, "exp1"))
    expected = runs.groupby(["context_size", "planner"])["mean_distance"].median().tolist()
    assert medians(own) == medians(named) == pytest.approx(expected)
    assert texts(own) == ["EB", "GB"]


def test_an_agent_shows_the_losses_of_its_training() -> None:
    """A published one: means over its two members, as the table of the report has them; a curve for each by member."""
    agent = affmap.load("exp1", context_size=8, members=(0, 3))
    rows = pd.read_csv(REPORT / "tables/validation.csv").query("context_size == 8 and member in (0, 3)")
    ax = affmap.plot.losses(agent, ax=axes())
    (curve,) = (line for line in ax.lines if len(line.get_xdata()) == 50)
    assert list(curve.get_ydata()) == pytest.approx(rows.groupby("epoch")["validation_nll"].mean().tolist())
    assert to_hex(curve.get_color()) == context_color(8) and texts(ax) == [] and ax.get_title("left") == ""
    ax = affmap.plot.losses(agent, by="member", ax=axes())
    curves = [list(line.get_ydata()) for line in ax.lines if len(line.get_xdata()) == 50]
    assert curves == [rows.query(f"member == {member}")["validation_nll"].tolist() for member in (0, 3)]
    agent.losses = None
    with pytest.raises(ConfigError, match=r"^the losses of the agent's training are unknown: an installed package"):
        affmap.plot.losses(agent)


def test_boxes_stand_at_their_values_in_the_colour_of_their_group() -> None:
    """Medians by hand: 3 u and 30 u, 8 u more at context size 8, the smaller size to the left."""
    ax = affmap.plot.boxes(make_runs(), "mean_distance", color="agent", ax=axes())
    assert medians(ax) == [30, 3, 38, 11] and texts(ax) == ["my b", "a"]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["0", "8"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("context size", "mean distance to the goal (u)")
    ax = affmap.plot.boxes(make_runs(), "mean_distance", by="agent", ax=axes())
    assert medians(ax) == [34, 7] and texts(ax) == []
    assert [label.get_text() for label in ax.get_xticklabels()] == ["my b", "a"]
    ax = affmap.plot.boxes(make_runs(), "mean_distance", by="agent", color="context_size", ax=axes())
    assert medians(ax) == [30, 38, 3, 11] and texts(ax) == ["C = 0", "C = 8"]
    assert [to_hex(handle.get_facecolor()) for handle in ax.get_legend().legend_handles] == [
        context_color(size) for size in (0, 8)
    ]


def test_steps_that_are_lacking_where_a_run_never_arrived_have_no_box_of_their_own() -> None:
    """As `affmap.fly` gives them: whole numbers, some of which are missing."""
    steps = pd.Series([3, None, 5, 4], dtype="Int64")
    ax = affmap.plot.boxes(pd.DataFrame({"agent": "a", "steps_to_reach": steps}), "steps_to_reach", "agent", ax=axes())
    assert medians(ax) == [4]


def test_agents_without_a_context_have_no_place_among_context_sizes() -> None:
    """As `affmap.evaluate` gives them: whole numbers, empty for an agent without a model; it stands among agents."""
    table = make_runs().assign(context_size=lambda rows: rows["context_size"].astype("Int64"))
    table.loc[table["agent"] == "a", "context_size"] = pd.NA
    assert medians(affmap.plot.boxes(table, "mean_distance", ax=axes())) == [30, 38]
    ax = affmap.plot.boxes(table, "mean_distance", "context_size", "agent", ax=axes())
    assert medians(ax) == [30, 38] and texts(ax) == []
    assert medians(affmap.plot.boxes(table, "mean_distance", by="agent", ax=axes())) == [34, 7]
    bars = affmap.plot.bars(table, "reached", ax=axes()).patches
    assert [bar.get_height() for bar in bars if bar.get_height()] == pytest.approx([0.4, 0.4])


def test_bars_are_shares_of_members() -> None:
    """By hand: two of five members have arrived; the interval lies around that."""
    ax = affmap.plot.bars(make_runs(), "reached", color="agent", ax=axes())
    assert [bar.get_height() for bar in ax.patches if bar.get_height()] == pytest.approx([0.4] * 4)
    low, high = np.array([line.get_ydata() for line in ax.lines]).T
    assert len(low) == 4 and (low < 0.4).all() and (high > 0.4).all()


def test_each_member_may_have_a_bar_of_its_own() -> None:
    """By hand: the odd members have arrived, in all of their runs."""
    ax = affmap.plot.bars(make_runs(), "reached", by="member", ax=axes())
    assert [bar.get_height() for bar in ax.patches][:5] == [0, 1, 0, 1, 0]
    ax = affmap.plot.bars(make_runs(), "reached", by="agent", color="member", ax=axes())
    assert sum(bar.get_height() for bar in ax.patches) == 4


def test_runs_are_drawn_as_their_table() -> None:
    """Medians of the table of a flight."""
    runs = affmap.fly(affmap.load("exp1", context_size=1, members=(0, 3)), "original", runs=3, steps=2)
    expected = runs.table.groupby("member")["mean_distance"].median().tolist()
    assert medians(affmap.plot.boxes(runs, "mean_distance", by="member", ax=axes())) == pytest.approx(expected)
    with pytest.raises(ConfigError, match="no column 'context_size'; it has member, run"):
        affmap.plot.boxes(runs, "mean_distance")
    with pytest.raises(ConfigError, match=r"^runs have no losses; give the agent that has flown them, or its `losses`"):
        affmap.plot.losses(runs)


def test_wrong_tables_are_told_in_a_sentence() -> None:
    runs, agent = make_runs(), affmap.load("exp1")
    for wrong, message in (
        (lambda: affmap.plot.boxes("exp11", "mean_distance"), "exp11 is no report with tables/runs.csv: give a table"),
        (lambda: affmap.plot.boxes(agent, "mean_distance"), r"^Agent\(1 member, .* is no report with tables/runs.csv"),
        (lambda: affmap.plot.losses(runs), "no column 'epoch'; it has agent, context_size, member"),
        (lambda: affmap.plot.losses(make_losses(), by="beta"), "no column 'beta'; it has context_size"),
        (lambda: affmap.plot.losses(make_losses()[:0]), "has no rows, and so no losses"),
        (lambda: affmap.plot.boxes(runs[:0], "mean_distance"), "no row with a value of context_size"),
        (lambda: affmap.plot.boxes(runs, "distance"), "there is no metric 'distance'; there are: validation_nll, "),
        (lambda: affmap.plot.boxes(runs, "success"), "no column 'success'; it has agent"),
        (lambda: affmap.plot.boxes(runs, "reached"), "reached is a yes or no .* with affmap.plot.bars"),
        (lambda: affmap.plot.bars(runs.drop(columns="member"), "reached"), "no column 'member'"),
    ):
        with pytest.raises(ConfigError, match=message):
            wrong()
