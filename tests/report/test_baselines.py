"""Lines, text and tables of agents without a learned model: heights against medians and means computed here."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from contents import content_of, table_of
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from affmap.experiments import open_room
from affmap.report import build
from affmap.report.drawing import numbers
from affmap.report.drawing.colors import Groups
from affmap.report.experiment import ExperimentReport
from affmap.report.figures import outcomes
from affmap.report.figures import results as main_results
from affmap.results import scores
from affmap.results.numbers import number
from affmap.results.setting import ReportSettings, Setting
from affmap.results.tables import Results

CONF = Path(__file__).parents[2] / "conf"
WriteStages = Callable[..., list[Setting]]
PLANNERS = Groups("planner", {"cem": "EB"}, {"EB": "#0072B2"})
LAYOUTS = Groups("layout", {"a": "easy", "b": "hard"}, {"easy": "#44aa99", "hard": "#882255"})
AGENTS = ("oracle", "straight")


def panel(bottom: float, top: float) -> Axes:
    ax = Figure().subplots()
    ax.set_ylim(bottom, top)
    return ax


def table(**values: Sequence[float]) -> pd.DataFrame:
    """Runs of agents in two layouts: `oracle_a=[...]` are the distances of the oracle in layout a."""
    parts = [
        pd.DataFrame({"planner": name.split("_")[0], "layout": name.split("_")[1], "mean_distance": each})
        for name, each in values.items()
    ]
    return pd.concat(parts, ignore_index=True)


def heights(ax: Axes) -> list[float]:
    """Of the horizontal lines through a whole panel, which they are."""
    lines = [line for line in ax.lines if list(line.get_xdata()) == [0, 1] and len(set(line.get_ydata())) == 1]
    return [float(np.asarray(line.get_ydata())[0]) for line in lines]


def test_a_line_is_the_median_of_an_agent_s_runs_in_a_layout() -> None:
    """By hand; agents have a style each, layouts a colour where colours tell these apart, and a legend both agents."""
    runs = table(oracle_a=[0.2, 0.3, 0.7], oracle_b=[0.5, 0.6], straight_a=[0.9, 0.9, 0.1], straight_b=[0.8])
    expected = [0.3, 0.55, 0.9, 0.8]
    by_layout, by_planner = panel(0.0, 1.0), panel(0.0, 1.0)
    handles = numbers.baselines(by_layout, runs, "mean_distance", LAYOUTS)
    numbers.baselines(by_planner, runs, "mean_distance", PLANNERS)
    for ax, colors in ((by_layout, ["#44aa99", "#882255"] * 2), (by_planner, ["#404040"] * 4)):
        assert heights(ax) == pytest.approx(expected)
        assert [to_hex(str(line.get_color())) for line in ax.lines] == colors
        offsets, styles = zip(*(line._dash_pattern for line in ax.lines), strict=True)  # type: ignore[attr-defined]
        assert styles[0] == styles[1] != styles[2] == styles[3]
        periods = [sum(styles[0]) / 2, sum(styles[2]) / 2] if ax is by_layout else [0.0, 0.0]
        assert offsets == pytest.approx([0.0, periods[0], 0.0, periods[1]]), "colours at one height alternate"
        assert ax.get_ylim() == (0.0, 1.0) and not ax.texts
    assert [handle.get_label() for handle in handles] == ["oracle", "straight"]


def test_each_agent_has_a_style_of_its_own_in_every_report() -> None:
    """Whichever others there are; one that is not affmap's has a solid line."""
    every = table(oracle_a=[0.2], seen_a=[0.3], straight_a=[0.4], random_a=[0.5], mine_a=[0.6])
    two = every[every["planner"].isin(["straight", "random"])]
    looks = [
        {
            str(handle.get_label()): handle
            for handle in numbers.baselines(panel(0.0, 1.0), runs, "mean_distance", PLANNERS)
        }
        for runs in (every, two)
    ]
    first, second = ({name: str(line._dash_pattern) for name, line in each.items()} for each in looks)  # type: ignore[attr-defined]
    assert second == {name: first[name] for name in ("straight", "random")}
    assert len({*first.values()}) == 5 and looks[0]["mine"].get_linestyle() == "-"  # type: ignore[attr-defined]


@pytest.mark.parametrize(("metric", "middle"), [("reached", mean), ("success", mean), ("steps_touching", median)])
def test_shares_have_the_mean_and_numbers_the_median(metric: str, middle: Callable[[Any], float]) -> None:
    """Python's own statistics; they differ here."""
    values = [True, True, True, False] if middle is mean else [1, 2, 3, 30]
    runs = pd.DataFrame({"planner": "random", "layout": "a", metric: values})
    ax = panel(0.0, 10.0)
    numbers.baselines(ax, runs, metric, PLANNERS)
    assert heights(ax) == [middle(values)] and mean(values) != median(values)
    assert scores.center(runs[metric], metric) == middle(values)
    assert scores.statistic(metric) == middle.__name__


def test_a_line_far_above_is_a_number_instead() -> None:
    """By hand: the panel is 1 u high from 0 to 1; a line at 1.1 u is still drawn, one at 1.2 u is not."""
    ax = panel(0.0, 1.0)
    runs = table(oracle_a=[1.1], straight_a=[1.2, 1.2], straight_b=[5.04], random_a=[0.5])
    handles = numbers.baselines(ax, runs, "mean_distance", PLANNERS)
    assert heights(ax) == [1.1, 0.5]
    assert [text.get_text() for text in ax.texts] == ["beyond this axis: straight 5.0"]
    assert [handle.get_label() for handle in handles] == ["oracle", "random"]
    assert ax.get_ylim() == pytest.approx((0.0, 1.14))


def test_a_panel_grows_down_to_a_line_but_not_below_zero() -> None:
    """By hand, with 4 % of the height beside the line; where nothing was predicted, nothing is drawn."""
    errors = pd.DataFrame({"planner": "oracle", "layout": "a", "prediction_error": [-12.0, -11.0, -10.0]})
    ax = panel(-10.0, -5.0)
    numbers.baselines(ax, errors, "prediction_error", PLANNERS)
    assert heights(ax) == [-11.0] and ax.get_ylim() == pytest.approx((-11.2, -5.0))
    ax = panel(0.0, 1.0)
    numbers.baselines(ax, table(oracle_a=[0.0]), "mean_distance", PLANNERS)
    assert heights(ax) == [0.0] and ax.get_ylim() == (0.0, 1.0)
    for lacking in (errors.assign(prediction_error=np.nan), errors.assign(prediction_error=[-1.0, np.nan, -2.0])):
        ax = panel(-10.0, -5.0)
        assert numbers.baselines(ax, lacking, "prediction_error", PLANNERS) == []
        assert not ax.lines and not ax.texts and ax.get_ylim() == (-10.0, -5.0)


def settings(experiment: str) -> ReportSettings:
    own = yaml.safe_load((CONF / f"experiment/{experiment}.yaml").read_text("utf-8"))["report"]
    default = yaml.safe_load((CONF / "report/default.yaml").read_text("utf-8"))
    return ReportSettings.model_validate(default | own | {"names": default["names"] | own.get("names", {})})


@pytest.fixture(scope="module")
def results(write_stages: WriteStages, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Results]:
    """Experiments I and V, with flights of two more agents with the first context size."""
    root, found = tmp_path_factory.mktemp("stages"), {}
    for name in ("exp1", "exp5"):
        own = write_stages(root, (0, 8), members=2, epochs=2, experiment=name)
        others = write_stages(root, (0,), AGENTS, members=2, epochs=2, experiment=name)
        others.sort(key=lambda setting: AGENTS.index(setting.planner))
        found[name] = Results(tuple(own), baselines=tuple(others))
    return found


def raw(results: Results) -> dict[tuple[str, str], pd.DataFrame]:
    """Agent and layout -> its stored runs, read here."""
    return {(each.planner, each.layout): pd.read_csv(each.control[0] / "runs.csv") for each in results.baselines}


@pytest.mark.parametrize("name", ["exp1", "exp5"])
def test_the_table_has_every_run_of_every_baseline_and_no_other(results: dict[str, Results], name: str) -> None:
    """Against the stored tables, in the order of the agents; the runs of the experiment are what they were."""
    found, stored = results[name].baseline_runs, raw(results[name])
    assert len(stored) == (2 if name == "exp1" else 4)
    assert list(dict.fromkeys(found["planner"])) == list(AGENTS)
    for (agent, layout), runs in stored.items():
        mine = found[(found["planner"] == agent) & (found["layout"] == layout)].reset_index(drop=True)
        assert len(mine) == len(runs) == 8
        for key in ("member", "run", "mean_distance", "reached", "success", "prediction_error"):
            pd.testing.assert_series_equal(mine[key], runs[key], check_dtype=False)
    assert len(found) == 8 * len(stored)
    assert "context_size" not in found and "lookup_spacing" not in found
    without = replace(results[name], baselines=())
    pd.testing.assert_frame_equal(results[name].runs, without.runs)
    assert without.baseline_runs.empty
    folders = {folder for setting in results[name].baselines for folder in setting.control}
    assert folders <= set(results[name].provenance) and not folders & set(without.provenance)


@pytest.mark.parametrize("name", ["exp1", "exp5"])
def test_the_figures_have_a_line_for_each_agent_and_layout(results: dict[str, Results], name: str) -> None:
    """Medians and means of the stored tables; lines that lie far above are told, and the legend names the agents."""
    chosen = settings(name)
    for draw in (main_results.draw, outcomes.draw):
        both = results[name], replace(results[name], baselines=())
        drawn, plain = (draw(each, chosen).figure for each in both)
        metrics = {
            "prediction error": "prediction_error",
            "distance to the goal": "mean_distance",
            "success": "success",
            "reached": "reached",
            "touching": "steps_touching",
        }
        found = 0
        for ax, before in zip(drawn.axes, plain.axes, strict=True):
            added = [height for height in heights(ax) if height not in heights(before)]
            if not added and len(ax.texts) == len(before.texts):
                continue
            metric = next(key for words, key in metrics.items() if words in ax.get_ylabel())
            expected = []
            for runs in raw(results[name]).values():
                values = runs[metric].astype(float).tolist()
                expected.append(mean(values) if metric in ("success", "reached") else median(values))
            top = max(before.get_ylim()[1], *added) if added else before.get_ylim()[1]
            shown = [height for height in expected if height <= top]
            assert added == pytest.approx(shown), metric
            beyond = any("beyond this axis" in text.get_text() for text in ax.texts)
            assert beyond == (len(shown) < len(expected))
            found += 1
        assert found >= 1
        labels = [text.get_text() for legend in drawn.legends for text in legend.get_texts()]
        assert labels == ["agents without a learned model:", *AGENTS] and not plain.legends


@pytest.mark.parametrize("name", ["exp1", "exp5"])
def test_the_report_has_a_row_for_each_agent_and_layout(results: dict[str, Results], name: str) -> None:
    """Medians and means of the stored tables as text; the outcome of Experiment V is success, beside the reached."""
    chosen = settings(name)
    _, rows = table_of(content_of(results[name], chosen).baselines())
    metrics = ["prediction_error", *(["mean_distance"] if name == "exp1" else ["success"]), "reached", "steps_touching"]
    expected = []
    for (agent, layout), runs in raw(results[name]).items():
        centers = [
            (mean if metric in ("success", "reached") else median)(runs[metric].astype(float).tolist())
            for metric in metrics
        ]
        shown = {"original": "original", "procedural_easy": "easy", "procedural_hard": "hard"}[layout]
        expected.append([agent, shown, "8", *map(number, centers)])
    assert rows == expected
    assert content_of(replace(results[name], baselines=()), chosen).baselines() == ""


def test_the_report_writes_their_runs(results: dict[str, Results], tmp_path: Path) -> None:
    """Into a table of their own, row by row as in memory; without baselines there is no such file."""
    told = {"name": "exp1", "title": "One", "command": "affmap"}
    for output, found in (("with", results["exp1"]), ("without", replace(results["exp1"], baselines=()))):
        report = ExperimentReport(
            tmp_path / output, found, settings("exp1"), open_room("exp1", "exp1"), **told, notice=None
        )
        build.write(report)
    written = pd.read_csv(tmp_path / "with/tables/baselines.csv")
    assert list(written.columns) == list(results["exp1"].baseline_runs.columns)
    assert written["planner"].tolist() == ["oracle"] * 8 + ["straight"] * 8
    np.testing.assert_allclose(written["mean_distance"], results["exp1"].baseline_runs["mean_distance"])
    assert not (tmp_path / "without/tables/baselines.csv").exists()
    for output, expected in (("with", True), ("without", False)):
        page = (tmp_path / output / "report.html").read_text("utf-8")
        assert ("Agents without a learned model" in page) == expected
    runs = [(tmp_path / output / "tables/runs.csv").read_bytes() for output in ("with", "without")]
    assert runs[0] == runs[1]


def test_many_boxes_with_names_have_a_row_a_panel_and_agents_beside_them(results: dict[str, Results]) -> None:
    """Seven names in two layouts; the bars of the agents are means of the stored tables, and no line hides a box."""
    names = [f"horizon {letter}" for letter in "abcdefg"]
    own = [each for each in results["exp5"].settings if each.context_size == 8 and each.planner == "cem"]
    flown = [Setting({**each.values, "lookahead": name}, each.folders) for name in names for each in own]
    keys = {"x_key": "lookahead", "color_key": "control_layout"}
    found, chosen = Results(tuple(flown), **keys, baselines=results["exp5"].baselines), settings("exp5")
    drawn = outcomes.draw(found, chosen)
    shown = [f"lookahead = {name}" for name in names] + [*AGENTS]
    for ax in drawn.figure.axes:
        assert [label.get_text() for label in ax.get_xticklabels()] == shown and not heights(ax)
    assert [ax.get_title("left") for ax in drawn.figure.axes] == ["A  Arrivals", "B  Contact", "C  Distance"]
    easy, hard = ([bar.get_height() for bar in bars] for bars in drawn.figure.axes[0].containers)  # type: ignore[union-attr]
    means = {pair: float(runs["reached"].mean()) for pair, runs in raw(found).items()}
    assert easy[7:] == pytest.approx([means[agent, "procedural_easy"] for agent in AGENTS])
    assert hard[7:] == pytest.approx([means[agent, "procedural_hard"] for agent in AGENTS])
    assert "Right: agents without a learned model." in drawn.caption
    few = outcomes.draw(replace(found, settings=tuple(flown[:4])), chosen)
    assert all(ax.get_subplotspec().get_gridspec().nrows == 1 for ax in few.figure.axes)  # type: ignore[union-attr]
    assert "Right:" not in few.caption
