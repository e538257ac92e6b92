"""References: hand-computed boxes, bars and rules; a member's own map for its colours."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from stage_files import make_world

from affmap.env.geometry import reachable
from affmap.env.layout import Layout
from affmap.env.scene import LAYERS, Mark
from affmap.model.palette import Palette
from affmap.report import figures, painted
from affmap.report.drawing import arena, files, losses, numbers
from affmap.report.drawing import failures as panels
from affmap.report.drawing.colors import GROUP_COLORS, Groups, make_groups, names_of, x_colors
from affmap.report.figures import exploration
from affmap.report.figures import failures as figure_of_failures
from affmap.report.figures import results as main_results
from affmap.report.figures import world as world_figure
from affmap.results import examples, failures
from affmap.results.files import Trajectories
from affmap.results.setting import CONTEXT_SIZE, PLANNER, Factor, ReportSettings, Setting, make_factor
from affmap.results.tables import Results
from affmap.settings import ConfigError

WriteStages = Callable[..., list[Setting]]
RADIUS = 0.06
HARD = {"control_layout": "procedural_hard"}
PLANNERS = Groups("planner", {"cem": "EB"}, {"EB": "#0072B2"})
SETTINGS = ReportSettings(
    map_spacing=0.02,
    snapshots=False,
    compare=None,
    partial=False,
    claims=None,
    names={"procedural_easy": "easy", "procedural_hard": "hard", "three_looks": "hard"},
    outcome="success",
    axes={},
)


@pytest.fixture(scope="module")
def results(write_stages: WriteStages, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Results]:
    root = tmp_path_factory.mktemp("stages")
    names = ("exp1", "exp2", "exp3", "exp4", "exp5")
    return {
        name: Results(tuple(write_stages(root, (0, 8, 16), ("cem",), members=2, epochs=1, experiment=name)))
        for name in names
    }


def test_errors_far_beyond_the_others_have_a_logarithmic_axis_that_says_so() -> None:
    """Boxes up to 9 and up to 5,000 nats."""
    for scale, kind in ((1.0, "linear"), (1000.0, "symlog")):
        errors = [-9.0, -8.0, -7.0, 3 * scale, 4 * scale, 5 * scale]
        runs = pd.DataFrame({"context_size": 0, "planner": "cem", "prediction_error": errors})
        ax = numbers.boxes(Figure().subplots(), runs, "prediction_error", PLANNERS)
        assert ax.get_yscale() == kind and ("log beyond" in ax.get_ylabel()) == (kind == "symlog")


def test_box_plots_are_the_papers() -> None:
    """1 to 8 and an outlier: quartiles 3 and 7, whiskers to 1 and 8 (limits -3 and 13), no point at 90."""
    values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 90.0]
    runs = pd.DataFrame({"context_size": 0, "planner": "cem", "mean_distance": values})
    ax = numbers.boxes(Figure().subplots(), runs, "mean_distance", PLANNERS)
    box = np.asarray(ax.patches[0].get_path().vertices)[:, 1]
    assert (box.min(), box.max()) == (3.0, 7.0)
    drawn = np.concatenate([np.asarray(line.get_ydata()) for line in ax.lines])
    assert set(drawn) == {1.0, 3.0, 5.0, 7.0, 8.0}, "whisker ends, quartiles and the median, no outlier"


def test_a_panel_of_agents_that_predict_nothing_says_so() -> None:
    """Its only words, instead of boxes and lines; beside others they have a name and no box."""
    runs = pd.DataFrame({"context_size": [0, 0, 0], "planner": "random", "prediction_error": np.nan})
    groups = Groups("planner", {"cem": "EB", "random": "random"}, {"EB": "#0072B2", "random": "#44AA99"})
    ax = numbers.boxes(Figure().subplots(), runs, "prediction_error", groups, (-12.0, -8.0))
    assert [text.get_text() for text in ax.texts] == ["no prediction error:\nnothing was predicted"]
    assert not ax.patches and not ax.lines
    steps = runs.assign(acting=[0, 1, 1])
    ax = panels.step_errors(Figure().subplots(), steps)
    assert [text.get_text() for text in ax.texts] == ["no step error:\nnothing was predicted"] and not ax.lines
    both = pd.concat([runs, runs.assign(planner="cem", prediction_error=[-9.0, -8.0, -7.0])], ignore_index=True)
    ax = numbers.boxes(Figure().subplots(), both, "prediction_error", groups)
    assert sum(isinstance(patch, PathPatch) for patch in ax.patches) == 1 and not ax.texts
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["EB", "random"]


def test_names_without_a_number_have_no_place_on_the_axis() -> None:
    """Of an agent and a policy, which predicts nothing; the distance of both is shown."""
    runs = pd.DataFrame({"planner": ["cem"] * 3 + ["ppo"] * 3, "layout": "original", "prediction_error": [-9.0, -8, -7]
                         + [np.nan] * 3, "mean_distance": 1.0})  # fmt: skip
    names = {"cem": "agent", "ppo": "PPO"}
    groups = Groups("layout", {"original": "home"}, {"home": "#0072B2"}, PLANNER, names)
    for metric, shown in (("prediction_error", ["agent"]), ("mean_distance", ["agent", "PPO"])):
        ax = numbers.boxes(Figure().subplots(), runs, metric, groups)
        assert [text.get_text() for text in ax.get_xticklabels()] == shown


def test_errors_that_are_infinite_have_no_boxes() -> None:
    runs = pd.DataFrame({"context_size": [0, 0], "planner": "cem", "prediction_error": np.inf})
    assert not numbers.boxes(Figure().subplots(), runs, "prediction_error", PLANNERS).patches


def test_the_curve_of_one_member_has_an_axis_without_a_deviation() -> None:
    """By hand: with a context from -9 to -8 nats, without one far above; 5 % more, and room for the words above."""
    rows = [(0, 0, 1, 100.0), (0, 0, 2, 90.0), (8, 0, 1, -8.0), (8, 0, 2, -9.0)]
    table = pd.DataFrame(rows, columns=["context_size", "member", "epoch", "validation_nll"])
    ax = losses.learning_curves(Figure().subplots(), table)
    assert ax.get_ylim() == pytest.approx((-9.05, -7.95 + 0.13), abs=0.02)
    (words,) = ax.texts
    ax.figure.draw_without_rendering()
    assert words.get_text() == "C = 0: 100.0 at its worst, 90.0 at the end"
    assert ax.transData.inverted().transform(words.get_window_extent())[0, 1] > -8, "above the curves"


def test_shapes_far_larger_than_the_arena_are_cut_down() -> None:
    """Agg takes minutes for the outline of what a model that has diverged predicts."""
    ax = Figure().subplots()
    arena.paint_marks(ax, [Mark(LAYERS["uncertainty"], np.full((1, 2), -1e30), np.full(2, 1e30))])
    (shape,) = ax.patches
    assert (shape.width, shape.height, *shape.get_center()) == (2e3, 2e3, -1e3, -1e3)


def test_bars_are_means_and_standard_deviations_over_members() -> None:
    """By hand: members' shares 0, 1/2 and 1; mean 1/2, standard deviation 1/2."""
    runs = pd.DataFrame({"context_size": 0, "planner": "cem", "member": [0, 0, 1, 1, 2, 2]})
    runs["success"] = [False, False, True, False, True, True]
    ax = numbers.bars(Figure().subplots(), runs, "success", PLANNERS)
    assert ax.patches[0].get_height() == 0.5
    assert sorted(ax.lines[0].get_ydata()) == pytest.approx([0.0, 1.0])
    runs["success"] = [True, True, True, True, False, False]  # 2/3, and a deviation of 0.577
    ax = numbers.bars(Figure().subplots(), runs, "success", PLANNERS)
    assert sorted(ax.lines[0].get_ydata()) == pytest.approx([2 / 3 - 1 / 3**0.5, 1.0]), "no share is above 1"
    assert ax.get_ylim() == (0, 1.05)


def test_a_bar_without_height_is_told_from_none() -> None:
    """By hand: no run at size 0 succeeds, and size 3 was not flown by EB; of failures, there are none at size 3."""
    both = Groups("planner", {"cem": "EB", "gradient": "GB"}, {"EB": "#0072B2", "GB": "#E69F00"})
    runs = pd.DataFrame({"context_size": [0, 1, 0, 1, 3], "planner": ["cem"] * 2 + ["gradient"] * 3, "member": 0})
    runs["success"] = [False, True, True, True, False]
    ax = numbers.bars(Figure().subplots(), runs, "success", both)
    assert [text.get_text() for text in ax.texts] == ["0", "0"]
    assert [text.xy for text in ax.texts] == [(pytest.approx(-0.2), 0.0), (pytest.approx(2.2), 0.0)]
    failed = pd.DataFrame({"context_size": [0, 3], "reason": ["stuck", ""]})
    ax = panels.reasons(Figure().subplots(), failed)
    assert [(text.get_text(), text.xy) for text in ax.texts] == [("0", (1, 0.0))]


@pytest.mark.parametrize("width", [7.0, 3.5, 2.0])
def test_a_legend_leaves_room_for_the_title(width: float) -> None:
    """By the extents of what is drawn, in wide panels and narrow ones; beside the title where there is room."""
    with files.style():
        figure = files.new_figure(2.5, width)
        ax = figure.subplots()
        for name in ("original", "2 obstacles", "12 obstacles"):
            ax.plot([0, 1], label=name)
        numbers.titled(numbers.legend_above(ax), "C  Prediction error")
        figure.draw_without_rendering()
        legend, title = ax.get_legend().get_window_extent(), ax._left_title.get_window_extent()
        assert not legend.overlaps(title) and not legend.overlaps(ax.get_window_extent())
        assert (legend.y0 < title.y1) == (width == 7.0)
        assert figure.bbox.x0 <= legend.x0 and legend.y1 <= figure.bbox.y1


def test_a_legend_of_several_lines_has_each_heading_before_its_own_entries(tmp_path: Path) -> None:
    """Read from the picture, line by line; a heading without entries has no line."""
    lines = {"one:": ["a", "b", "c"], "none:": [], "two:": ["d"]}
    figure = files.new_figure(2.0)
    figure.subplots()
    numbers.legend_below(figure, {name: [Patch(label=each) for each in own] for name, own in lines.items()})
    files.save(figure, tmp_path / "figure", None)
    texts = [text for text in figure.legends[0].get_texts() if text.get_text()]
    places = {text.get_text(): text.get_window_extent() for text in texts}
    heights = sorted({round(place.y0) for place in places.values()}, reverse=True)
    found = [sorted((place.x0, name) for name, place in places.items() if round(place.y0) == y) for y in heights]
    assert [[name for _, name in line] for line in found] == [["one:", "a", "b", "c"], ["two:", "d"]]


def test_values_that_are_names_are_readable_and_in_the_order_of_the_report() -> None:
    """By hand: MLP before GRU, in every panel whose axis or curves are transition models."""
    kind, readable = Factor("model.transition", "kind_of_model", "transition"), {"mlp": "MLP", "gru": "GRU"}
    table = pd.DataFrame({"kind_of_model": ["mlp", "gru"], "reason": "fog", "nearest": "fog", "distance": 0.1})
    table = table.assign(acting=0, prediction_error=-8.0, kind="free", median=-8.0, mean=-7.0)
    axes = [Figure().subplots() for _ in range(5)]
    panels.reasons(axes[0], table, kind, readable)
    panels.nearest(axes[1], table, kind, readable)
    panels.fog_distances(axes[2], table, ["mlp", "gru"], kind, readable)
    losses.step_losses(axes[3], table[::-1], "free", kind, readable)
    for ax in axes[:4]:
        assert [label.get_text() for label in ax.get_xticklabels()] == ["MLP", "GRU"]
    panels.step_errors(axes[4], table, kind, readable)
    assert axes[4].get_legend_handles_labels()[1] == ["MLP", "GRU"]


def test_each_column_of_a_grid_has_an_axis_at_its_foot() -> None:
    """By hand: four of six places are used, so the last two columns end in the first row."""
    grid = Figure().subplots(2, 3, sharex=True, sharey=True)
    for ax in grid.flat:
        ax.set(xlabel="x", ylabel="y")
    arena.label_outer(grid, 4)
    assert [ax.get_xlabel() for ax in grid.flat[:4]] == ["", "x", "x", "x"]
    assert [ax.xaxis.get_tick_params()["labelbottom"] for ax in grid.flat[:4]] == [False, True, True, True]
    assert [ax.get_ylabel() for ax in grid.flat[:4]] == ["y", "", "", "y"]
    assert [ax.axison for ax in grid.flat] == [True] * 4 + [False] * 2


def test_panels_without_anything_to_show_say_so(world: Layout) -> None:
    """No run failed, none arrived nowhere, no step was outside fog, and none had two circles acting on it."""
    runs = pd.DataFrame({"context_size": [0, 8], "reason": "", "nearest": ""})
    steps = pd.DataFrame({"context_size": [0, 0], "acting": [0, 1], "prediction_error": [-9.0, -8.0]})
    ends = pd.DataFrame({"context_size": [0, 8], "distance": [0.1, 0.2]})
    for said, draw in (
        ("no run failed", lambda ax: panels.reasons(ax, runs)),
        ("every run arrived", lambda ax: panels.nearest(ax, runs)),
        ("no step was outside fog", lambda ax: panels.step_errors(ax, steps[:0])),
        ("no such step", lambda ax: panels.step_errors(ax, steps)),
        ("every run arrived", lambda ax: panels.fog_distances(ax, ends[:0], [0, 8])),
        ("no run", lambda ax: arena.heat(ax, np.empty((0, 2)), world)),
    ):
        (words,) = draw(Figure().subplots()).texts
        assert " ".join(words.get_text().split()) == said
    failed, all_steps = runs.assign(reason="stuck", nearest="surface"), pd.concat([steps, steps.assign(acting=3)])
    for draw in (
        lambda ax: panels.reasons(ax, failed),
        lambda ax: panels.nearest(ax, failed),
        lambda ax: panels.step_errors(ax, all_steps),
        lambda ax: panels.fog_distances(ax, ends, [0, 8]),
    ):
        assert not draw(Figure().subplots()).texts


def test_failures_are_stacked_by_their_reasons() -> None:
    """By hand: of four runs one is stuck, one was in fog and arrived, one was in fog and did not."""
    runs = pd.DataFrame({"context_size": 3, "reason": ["", "stuck", "fog", "fog"]})
    ax = panels.reasons(Figure().subplots(), runs)
    heights = {bars.get_label(): (bars[0].get_y(), bars[0].get_height()) for bars in ax.containers}
    expected = {"was in fog": (0, 0.5), "never arrived: stuck": (0.5, 0.25), "never arrived: other": (0.75, 0)}
    assert heights == expected


def test_the_reason_of_a_failure(results: dict[str, Results]) -> None:
    """By construction: who was in fog arrived, too; who did not arrive has stopped."""
    runs = failures.with_reasons(results["exp5"])
    assert (runs["reason"] == "").equals(runs["success"])
    assert set(runs.loc[runs["steps_in_fog"] > 0, "reason"]) == {"fog"}
    assert set(runs.loc[~runs["reached"], "reason"]) == {"stuck"}
    moving = Results(results["exp5"].settings)
    moving.runs["final_spread"] = 0.13  # the vehicle is 0.12 u wide
    assert set(failures.with_reasons(moving).loc[~moving.runs["reached"], "reason"]) == {"other"}
    assert failures.are_of_interest(results["exp5"]) and failures.are_of_interest(results["exp4"])
    assert not failures.are_of_interest(results["exp1"])


def test_failures_are_placed_where_they_happened(results: dict[str, Results]) -> None:
    """By construction: in fog from the first step on; with a context only."""
    found = results["exp5"]
    jobs = [job for job in found.settings if job.layout == "procedural_hard" and job.context_size > 0]
    runs = found.runs[(found.runs["layout"] == "procedural_hard") & (found.runs["context_size"] > 0)]
    places = failures.places(found, found.where(HARD))
    assert len(places.fog) == (runs["steps_in_fog"] > 0).sum() > 0
    assert len(places.ended) == (~runs["reached"]).sum()
    first = found.trajectories(jobs[0])
    np.testing.assert_array_equal(places.fog[0], first.position[first.in_fog[:, 0].argmax(), 1])


def test_what_a_vehicle_is_nearest_to_by_hand() -> None:
    """Distances to rims and borders; inside of several circles the deepest counts."""
    circles = ((1.0, 1.0, 0.2, "obstacle"), (1.6, 1.0, 0.3, "fog"), (1.7, 1.0, 0.5, "force_up"))
    world = make_world(*circles)
    places = {(0.75, 1.0): "surface", (1.5, 0.05): "surface", (1.25, 1.1): "force_up", (2.5, 1.0): "force_up"}
    assert {place: failures.nearest(np.array(place), world) for place in places} == places
    fog = make_world(*circles, (1.7, 1.0, 0.6, "fog"))
    assert failures.nearest(np.array([1.7, 1.0]), fog) == "fog"


def test_runs_that_arrived_are_nearest_to_nothing(results: dict[str, Results]) -> None:
    found = results["exp5"]
    things = failures.with_nearest(found, found.where(HARD))
    runs = found.runs[found.runs["layout"] == "procedural_hard"]
    shares = failures.shares(things, "nearest", failures.things()).sum(axis=1)
    assert shares.to_dict() == (1 - runs.groupby("context_size")["reached"].mean()).to_dict()
    ax = panels.nearest(Figure().subplots(), things)
    assert sum(bar.get_height() for bar in ax.patches) == pytest.approx(shares.sum())


def test_errors_of_steps_by_hand(results: dict[str, Results]) -> None:
    """Against a loop over the steps of a run."""
    found = Results(tuple(job for job in results["exp5"].settings if job.layout == "procedural_hard")[:1])
    job = found.settings[0]
    paths, worlds = found.trajectories(job), found.run_layouts(job)
    steps = failures.step_errors(found, found.where(HARD))
    expected = []
    for run, world in enumerate(worlds):
        for step in range(paths.in_fog.shape[1]):
            if paths.in_fog[run, step] or (step > 0 and paths.in_fog[run, step - 1]):
                continue
            x, y = paths.position[run, step]
            over = [c for c in world.circles if np.hypot(x - c.x, y - c.y) < c.radius + RADIUS]
            error = 0.0
            for axis in range(2):
                mean, std = paths.planned_position[run, step, 0, axis], paths.planned_std[run, step, 0, axis]
                surprise = (paths.position[run, step + 1, axis] - mean) / std
                error += 0.5 * surprise**2 + np.log(std) + 0.5 * np.log(2 * np.pi)
            expected.append((min(len(over), 3), error))
    assert steps["acting"].tolist() == [count for count, _ in expected]
    assert steps["prediction_error"].to_numpy() == pytest.approx([error for _, error in expected])
    ax = panels.step_errors(Figure().subplots(), steps)
    assert ax.lines[0].get_ydata()[0] == pytest.approx(steps[steps["acting"] == 0]["prediction_error"].median())


def test_circles_without_effect_do_not_act() -> None:
    """By hand: in none, in one, in two of three circles."""
    world = make_world((1.0, 1.0, 0.2, "fog"), (1.2, 1.0, 0.2, "force_up"), (1.0, 1.0, 0.5, "none"))
    places = np.array([[2.0, 1.0], [0.8, 1.0], [1.1, 1.0], [1.46, 1.0]])
    assert failures.acting(places, world, RADIUS).tolist() == [0, 1, 2, 0]
    assert failures.acting(places, make_world(), RADIUS).tolist() == [0, 0, 0, 0]


def test_cells_of_a_heat_map_count_positions(world: Layout) -> None:
    """By hand: fifty positions in one cell, one in another, none elsewhere; few are drawn one by one."""
    positions = np.array([[0.05, 0.11]] * 50 + [[2.95, 1.95]])
    ax = arena.heat(Figure().subplots(), positions, world)
    counts = ax.images[0].get_array()
    assert counts[1, 0] == 50 and counts[19, 29] == 1 and counts.sum() == 51
    few = arena.heat(Figure().subplots(), positions[-3:], world)
    assert not few.images and few.lines[0].get_xydata().tolist() == positions[-3:].tolist()
    empty = arena.heat(Figure().subplots(), np.empty((0, 2)), world)
    assert not empty.images and len(empty.patches) == 2 * 6


def test_maps_of_the_same_models_share_a_basis(results: dict[str, Results]) -> None:
    """One map alone has the palette of its reachable nodes; in two worlds equal codes have equal colours."""
    parts = painted.maps_of_size(results["exp2"], 8)
    alone = arena.paint([(parts[0].maps, parts[0].world)], RADIUS, 1)[0]
    codes, fit = parts[0].maps.codes[1], reachable(parts[0].maps.nodes, parts[0].world, RADIUS)
    np.testing.assert_array_equal(alone, Palette.fit(codes[fit])(codes))
    first, second, _ = painted.paint(parts, 1)
    same = (parts[0].maps.codes[1] == parts[1].maps.codes[1]).all(axis=-1)
    assert same.sum() > 1000
    np.testing.assert_array_equal(first[same], second[same])
    assert np.abs(first - alone).max() > 0.01, "the second world counts, too"


def test_what_stands_in_place_of_the_curves(results: dict[str, Results]) -> None:
    """Only Experiment II shows the same models in several worlds; those that are new to them come first."""
    shown = {name: [part.world.name for part in painted.several_worlds(found)] for name, found in results.items()}
    assert shown.pop("exp2") == ["two_obstacles", "twelve_obstacles", "original"]
    assert not any(shown.values())


def test_the_papers_context_size_is_shown(results: dict[str, Results]) -> None:
    assert painted.map_size(results["exp5"]) == 8
    jobs = results["exp5"].settings
    assert painted.map_size(Results(tuple(job for job in jobs if job.context_size != 8))) == 16
    assert painted.map_size(Results(tuple(job for job in jobs if job.context_size == 0))) is None


def test_every_world_is_shown_once(results: dict[str, Results]) -> None:
    """By hand: four for training, three of each procedural layout, one for maps; and the only one of Experiment I."""
    shown = world_figure.shown_worlds(results["exp5"], SETTINGS)
    assert len(shown) == 4 + 3 + 3 + 1 and len(set(shown.values())) == 11
    assert {"training fog (training)", "hard (control, run 2)", "four properties (maps)"} <= shown.keys()
    assert list(world_figure.shown_worlds(results["exp1"], SETTINGS)) == ["original (training, control, maps)"]


def test_curves_are_drawn_for_each_training(results: dict[str, Results]) -> None:
    """Experiment III trains for both layouts, Experiment V once for both."""
    titled = {name: main_results.draw(results[name], SETTINGS).figure.axes for name in ("exp3", "exp5")}
    count = {name: sum(ax.get_xlabel() == "epoch" for ax in axes) for name, axes in titled.items()}
    assert count == {"exp3": 2, "exp5": 1}


def test_exploration_is_shown_in_every_world_of_every_data_set(results: dict[str, Results]) -> None:
    names = {name: [world.name for *_, world in exploration.explored(found)] for name, found in results.items()}
    assert names["exp1"] == names["exp2"] == ["original"]
    assert names["exp3"] == ["original", "three_looks"]
    assert names["exp5"] == ["training_obstacles", "training_fog", "training_force_up", "training_force_down"]


def test_groups_have_names_and_colours_of_their_own(results: dict[str, Results]) -> None:
    """Layouts where there are several, else planners."""
    groups = make_groups(results["exp5"], SETTINGS)
    assert (groups.column, groups.names) == ("layout", {"procedural_easy": "easy", "procedural_hard": "hard"})
    assert len(set(groups.palette.values())) == 2
    groups = make_groups(results["exp1"], SETTINGS)
    assert (groups.column, groups.names) == ("planner", {"cem": "cem"})
    first = results["exp2"].settings[0]
    other = replace(first, values={**first.values, "planner": "gradient"})
    with pytest.raises(ConfigError, match=r"context_size on the x axis and \w+ by colour, .* several values of "):
        Results((*results["exp2"].settings, other)).check_factors()


def test_a_name_beside_others_lacks_the_symbol_as_they_do() -> None:
    """A model of one's own, beside models with names; alone, the symbol says its key."""
    transition, settings = make_factor("model.transition"), ReportSettings.load("report", "default")
    assert [*names_of(transition, ["mlp", "my_linear"], settings).values()] == ["MLP", "my linear"]
    assert [*names_of(transition, ["my_linear"], settings).values()] == ["transition = my_linear"]
    assert [*names_of(CONTEXT_SIZE, [0, 8], settings).values()] == ["C = 0", "C = 8"]


def test_half_way_is_the_first_step_with_half_of_the_distance_left() -> None:
    position = np.zeros((1, 6, 2))
    position[0, :, 0] = [0.0, 0.3, 0.6, 0.4, 0.9, 1.0]
    plans, never, ids = np.zeros((1, 5, 20, 2)), np.zeros((1, 5), bool), np.zeros(1, int)
    actions, errors = np.zeros((1, 5, 4)), np.zeros((1, 5))
    goal = np.array([[1.0, 0.0]])
    paths = Trajectories(position, goal, plans, plans, actions, errors, never, never, never, ids, ids)
    assert examples.half_way(paths, 0) == 2
    stuck = paths._replace(position=position * 0.4)
    assert examples.half_way(stuck, 0) == 4, "never half way: the closest step that has a plan"


def test_the_example_is_the_lower_median_run_of_the_first_member(results: dict[str, Results]) -> None:
    for layout in results["exp2"].layouts:
        runs = results["exp2"].runs.query("layout == @layout and member == 0 and context_size != 8")
        order = runs.groupby("run")["mean_distance"].mean().sort_values().index
        chosen = examples.choose_examples(results["exp2"], {"planner": "cem", "control_layout": layout})
        assert [example.setting.context_size for example in chosen] == [0, 16]
        assert {(example.setting.layout, example.member, example.run) for example in chosen} == {(layout, 0, order[1])}


def test_examples_are_from_the_richest_worlds(results: dict[str, Results], monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: only worlds of runs 1 and 3 keep all their circles; these come first, the lower median ahead."""
    found, worlds, layout = results["exp5"], Results.run_layouts, "procedural_easy"

    def poorer(self: Results, setting: Setting) -> list[Layout]:
        whole, runs = worlds(self, setting), self.trajectories(setting).run
        return [
            each if run in (1, 3) else each.model_copy(update={"circles": each.circles[:1]})
            for each, run in zip(whole, runs, strict=True)
        ]

    assert "different things" not in examples.example_rule(results["exp4"])
    monkeypatch.setattr(Results, "run_layouts", poorer)
    runs = found.runs.query("layout == @layout and member == 0 and context_size != 8")
    order = [int(run) for run in runs.groupby("run")["mean_distance"].mean().sort_values().index]
    rich, rest = [run for run in order if run in (1, 3)], [run for run in order if run in (0, 2)]
    assert examples.middle_runs(found, layout) == [*rich, *rest]
    assert "of those in whose worlds circles do most different things" in examples.example_rule(found)


def test_legends_name_the_effects_that_are_there(results: dict[str, Results]) -> None:
    worlds = {name: found.run_layouts(found.settings[-1]) for name, found in results.items()}
    named = {name: [handle.get_label() for handle in arena.effect_handles(w)] for name, w in worlds.items()}
    assert named["exp1"] == [], "obstacles only: a caption is enough"
    assert named["exp3"] == ["no effect", "obstacle"] and named["exp4"] == ["fog"]
    assert named["exp5"] == ["pulls up", "pulls down", "fog", "obstacle"]


def test_part_of_the_settings_is_enough(results: dict[str, Results]) -> None:
    """One layout has all context sizes, the other only the smallest."""
    jobs = [job for job in results["exp5"].settings if job.layout == "procedural_easy" or job.context_size == 0]
    part = Results(tuple(jobs))
    draws = figures.figures_of(figures.__name__)
    drawn = {name: draw(part, SETTINGS) for name, draw in draws.items()}
    assert {name for name, each in drawn.items() if each} == draws.keys() - {"growth", "learning"}
    assert "(C) Prediction error in control, 8 runs a box" in drawn["results"].caption


def test_names_on_the_x_axis_have_colours_of_their_own() -> None:
    """Distinct ones, none of which is that of a group; sizes have those of a scale, whatever others there are."""
    names = ["mlp", "hyper", "additive", "split", "split_channels"]
    colors = x_colors(make_factor("model.transition"), names)
    assert len({*colors.values()}) == len(names) and not {*colors.values()} & {*GROUP_COLORS}
    assert x_colors(CONTEXT_SIZE, [0, 8])[8] == x_colors(CONTEXT_SIZE, [1, 5, 8])[8]


def test_worlds_without_fog_say_so(results: dict[str, Results], monkeypatch: pytest.MonkeyPatch) -> None:
    """Easy worlds, if only the hard ones had fog: the distance to it is no sign that runs arrived."""
    has_fog = failures.has_fog
    monkeypatch.setattr(failures, "has_fog", lambda found, job: job.layout == "procedural_hard" and has_fog(found, job))
    drawn = figure_of_failures.draw(results["exp5"], SETTINGS)
    assert drawn is not None
    last = [ax for ax in drawn.figure.axes if ax.get_title("left") == "distance to fog"]
    assert ["no fog in\nthese worlds" in [text.get_text() for text in ax.texts] for ax in last] == [True, False]
