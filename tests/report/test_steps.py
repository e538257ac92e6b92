"""Losses by kind of step in reports: by hand, and beside the validation loss that they make up."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from contents import content_of, table_of
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from stage_files import WriteStages

from affmap.report.drawing import failures, losses
from affmap.report.figures import maps as figure_of_maps
from affmap.report.figures import results as main_results
from affmap.report.figures import steps as figure_of_steps
from affmap.report.figures import trajectories
from affmap.results import files
from affmap.results.files import EVERYWHERE
from affmap.results.setting import ReportSettings, Setting
from affmap.results.tables import Results


@pytest.fixture(scope="module")
def results(write_stages: WriteStages, tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Of Experiment IV, with fog."""
    return Results(tuple(write_stages(tmp_path_factory.mktemp("steps"), (0, 8), members=5, experiment="exp4")))


@pytest.fixture(scope="module")
def transitions(write_stages: WriteStages, tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Of two transition models, the second of which has losses that are 100 nats larger."""
    settings: list[Setting] = []
    for number, kind in enumerate(("mlp", "gru")):
        root = tmp_path_factory.mktemp(kind)
        for setting in write_stages(root, (0, 8), ("cem",), members=5):
            table = files.read_steps(setting.predict[0])
            table[["median", "mean"]] += 100.0 * number
            files.write_steps(setting.predict[0], table)
            settings.append(Setting({**setting.values, "model.transition": kind}, setting.folders))
    return Results(tuple(settings))


def panels_of(figure: Figure, xlabel: str) -> list[Axes]:
    return [ax for ax in figure.axes if ax.get_xlabel() == xlabel]


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


def test_models_that_differ_in_another_key_have_points_and_panels_of_their_own(transitions: Results) -> None:
    """By hand: at every size the second kind lies 100 nats above the first, in its own colour and to its right."""
    figure = figure_of_steps.draw(transitions, ReportSettings.load("report", "default")).figure
    for ax in panels_of(figure, "context size"):
        assert len(ax.get_lines()) == 4
        (x, mlp, first), (other_x, gru, second) = (
            (line.get_xdata(), line.get_ydata(), to_hex(line.get_color()))
            for line in (ax.get_lines()[0], ax.get_lines()[2])
        )
        assert np.subtract(gru, mlp).tolist() == pytest.approx([100.0, 100.0])
        assert (other_x > x).all() and first != second
    titles = [ax.get_title("left") for ax in panels_of(figure, "epoch")]
    assert titles == ["MLP, C = 0", "MLP, C = 8", "GRU, C = 0", "GRU, C = 8"]
    heights = [ax.get_lines()[-1].get_ydata()[-1] for ax in panels_of(figure, "epoch")]
    assert np.subtract(heights[2:], heights[:2]).tolist() == pytest.approx([100.0, 100.0])
    assert {text.get_text() for text in figure.legends[0].get_texts()} >= {"MLP", "GRU", "mean step"}


def test_experiments_have_a_row_for_each_training(write_stages: WriteStages, tmp_path: Path) -> None:
    """Experiment III trains for easy and for hard, Experiment II once for three worlds."""
    settings = ReportSettings.load("report", "default")
    for experiment, count in (("exp2", 1), ("exp3", 2)):
        found = Results(tuple(write_stages(tmp_path, (0, 8), members=2, epochs=2, experiment=experiment)))
        figure = figure_of_steps.draw(found, settings).figure
        assert len(panels_of(figure, "epoch")) == 2 * count
        assert len(panels_of(figure, "context size")[0].get_lines()) == 2 * count


def test_a_caption_is_of_the_panels_that_there_are(write_stages: WriteStages, tmp_path: Path) -> None:
    """Kept weights of a single epoch leave nothing to draw over epochs."""
    settings = ReportSettings.load("report", "default")
    for epochs in (1, 2):
        found = Results(tuple(write_stages(tmp_path / str(epochs), (0, 8), members=2, epochs=epochs)))
        drawn = figure_of_steps.draw(found, settings)
        assert ("Bottom: " in drawn.caption) == ("Top: " in drawn.caption) == bool(panels_of(drawn.figure, "epoch"))
    assert "Bottom: " in drawn.caption


def test_the_main_figure_has_a_map_of_each_kind_of_model(transitions: Results) -> None:
    drawn = main_results.draw(transitions, ReportSettings.load("report", "default"))
    titles = [ax.get_title("left") for ax in drawn.figure.axes if ax.get_images()]
    (panel,) = drawn.figure.subfigs
    assert panel.get_suptitle() == "B  Affordance maps (C = 8, member 0)" and titles == ["MLP", "GRU"]
    assert "(B) Affordance maps" in drawn.caption


def test_of_many_models_the_first_and_the_last_ones_are_shown(write_stages: WriteStages, tmp_path: Path) -> None:
    """Six maps in a panel, three rows of members and three moments; captions name or count the others."""
    names = [f"model {letter}" for letter in "abcdefg"]
    every = [
        Setting({**setting.values, "model.transition": name}, setting.folders)
        for name in names
        for setting in write_stages(tmp_path / name, (8,), ("cem",), members=2, epochs=1)
    ]
    found, settings = Results(tuple(every), x_key="model.transition"), ReportSettings.load("report", "default")
    drawn = main_results.draw(found, settings)
    shown = [ax.get_title("left") for ax in drawn.figure.axes if ax.get_images()]
    assert [title.removeprefix("transition = ") for title in shown] == [names[0], *names[2:]]
    assert "6 of 7 affordance maps" in drawn.caption
    members = figure_of_maps.draw(found, settings)
    assert members is not None
    heads = [part.get_suptitle().rpartition(" = ")[2] for part in members.figure.subfigs[:3]]
    assert heads == [names[0], *names[5:]] and "model b”, “transition = model c”" in members.caption
    moments = trajectories.draw(found, settings)
    assert [ax.get_title("left").split(",")[0] for ax in moments.figure.axes if ax.axison] == [
        f"transition = {name}" for name in (names[0], *names[5:])
    ]
    assert "Of 7 values of transition, the first and the last two are shown." in moments.caption


def test_epochs_are_whole_numbers() -> None:
    """Three epochs and no other place have a tick, in both kinds of panels over epochs."""
    rows = [(0, epoch, "free", 3, -8.0, 8, -1.0) for epoch in (1, 2, 3)]
    columns = ["member", "epoch", "kind", "steps", "mean", "context_size", "validation_nll"]
    table = pd.DataFrame(rows, columns=columns)
    for ax in (
        losses.contributions(Figure().subplots(), table, ["free"]),
        losses.learning_curves(Figure().subplots(), table),
    ):
        assert {1.0, 2.0, 3.0} <= set(ax.get_xticks()) and not np.mod(ax.get_xticks(), 1).any()


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


def test_the_table_of_the_halo_has_a_column_for_each_model(write_stages: WriteStages, tmp_path: Path) -> None:
    """Two learners of one context size, with the names of the report, as on the x axis."""
    learners = [
        Setting({**setting.values, "learner": name}, setting.folders)
        for name in ("mlp_one", "split")
        for setting in write_stages(tmp_path / name, (8,), ("cem",), members=2, epochs=2, experiment="exp4")
    ]
    settings = ReportSettings.load("report", "default").model_copy(update={"names": {"mlp_one": "MLP, one"}})
    heads, rows = table_of(content_of(Results(tuple(learners), x_key="learner"), settings).halo())
    assert heads == ["Places", "MLP, one", "split"]
    assert rows == [["up to 0.05 u outside fog", "100%", "100%"], ["farther away", "0%", "0%"]]
