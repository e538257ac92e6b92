"""Losses by kind of step in reports: by hand, and beside the validation loss that they make up."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from contents import content_of, table_of
from matplotlib.figure import Figure
from stage_files import WriteStages

from affmap.report.drawing import failures, losses
from affmap.results.files import EVERYWHERE
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


@pytest.fixture(scope="module")
def results(write_stages: WriteStages, tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Of Experiment IV, with fog."""
    return Results(tuple(write_stages(tmp_path_factory.mktemp("steps"), (0, 8), members=5, experiment="exp4")))


def test_points_are_medians_over_members_between_their_quartiles() -> None:
    """By hand: five members at two context sizes."""
    rows = [(size, member, "free", size + member, 10.0 * member) for size in (0, 8) for member in range(5)]
    steps = pd.DataFrame(rows, columns=["context_size", "member", "kind", "median", "mean"])
    ax = losses.step_losses(Figure().subplots(), steps, "free")
    medians, means = (line.get_ydata() for line in ax.get_lines())
    assert list(medians) == [2.0, 10.0] and list(means) == [20.0, 20.0]
    quartiles = [[segment[:, 1].tolist() for segment in bars.get_segments()] for bars in ax.collections]
    assert quartiles == [[[1.0, 3.0], [9.0, 11.0]], [[10.0, 30.0], [10.0, 30.0]]]


def test_what_kinds_add_makes_the_mean_loss() -> None:
    """By hand: one member, three free steps of -8 nats and one of 40 that enters fog."""
    rows = [(0, 5, "free", 3, -8.0), (0, 5, "entering", 1, 40.0), (0, 9, "free", 3, -8.0), (0, 9, "entering", 1, 80.0)]
    steps = pd.DataFrame(rows, columns=["member", "epoch", "kind", "steps", "mean"])
    ax = losses.contributions(Figure().subplots(), steps, ["free", "entering"])
    drawn = {str(line.get_label()): line.get_ydata().tolist() for line in ax.get_lines()}
    assert drawn == {"free": [-6.0, -6.0], "entering": [10.0, 20.0], "all": [4.0, 14.0]}


def test_distances_to_fog_are_a_point_for_each_run_at_its_place_on_the_axis() -> None:
    ends = pd.DataFrame({"context_size": [0, 0, 8], "distance": [0.3, -0.1, 0.2]})
    ax = failures.fog_distances(Figure().subplots(), ends, [0, 1, 8])
    edge, points = ax.get_lines()
    assert list(edge.get_ydata()) == [0, 0] and points.get_ydata().tolist() == [0.3, -0.1, 0.2]
    assert np.abs(points.get_xdata() - [0, 0, 2]).max() <= 0.3


def test_the_table_has_the_medians_of_all_members(results: Results) -> None:
    """Against the rows of the stage's own file, read here; a single world is not told twice."""
    content = content_of(results, ReportSettings.load("report", "default"))
    heads, rows = table_of(content.steps())
    assert heads == ["Kind", "Steps", "C = 0", "C = 8"]
    last = results.steps[(results.steps["epoch"] == 4) & (results.steps["world"] == EVERYWHERE)]
    for row in rows:
        for size, cell in zip((0, 8), row[2:], strict=True):
            own = last[(last["kind"] == row[0]) & (last["context_size"] == size)]
            expected = [f"{own[column].median():.2f}".replace("-", "\N{MINUS SIGN}") for column in ("median", "mean")]
            assert cell == ", ".join(expected)
    assert [row[0] for row in rows] == ["free", "touching", "entering", "inside", "leaving"]
    assert table_of(content.halo())[1] == [["up to 0.05 u outside fog", "100%", "100%"], ["farther away", "0%", "0%"]]


def test_without_fog_there_is_no_halo(write_stages: WriteStages, tmp_path: Path) -> None:
    clear = Results(tuple(write_stages(tmp_path, (0, 8), ("cem",), members=2, epochs=2)))
    content = content_of(clear, ReportSettings.load("report", "default"))
    assert [row[0] for row in table_of(content.steps())[1]] == ["free", "touching"] and content.halo() == ""
