"""References: differences known by construction, and SciPy's bootstrap."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy import stats

from affmap.experiments.comparison import figures as contrasts
from affmap.experiments.comparison import report as comparison
from affmap.experiments.comparison.report import ComparisonReport
from affmap.report import build
from affmap.report.experiment import ExperimentReport, Room
from affmap.results import manifest
from affmap.results.setting import ReportSettings, Setting
from affmap.results.tables import Results
from affmap.settings import ConfigError

KEY = "lookup.spacing"
TOLD = {"name": "mine", "title": "Mine", "command": "affmap mine=1"}


def runs(shift: float, members: int = 8) -> pd.DataFrame:
    """Two look-ups on the same starts; the map has distances larger by `shift` and a little noise."""
    rng = np.random.default_rng(0)
    rows = []
    for member in range(members):
        for run in range(4):
            distance, noise = rng.uniform(0.4, 0.6), rng.normal(0, 0.001)
            for spacing, change in ((0.0, 0.0), (0.01, shift + noise)):
                row = {"planner": "cem", "layout": "original", "context_size": 8, "lookup_spacing": spacing}
                rows.append(
                    {
                        **row,
                        "member": member,
                        "run": run,
                        "mean_distance": distance + change,
                        "prediction_error": -9.0,
                        "validation_nll": -9.0,
                        "reached": True,
                        "success": True,
                        "lookup_error": spacing,
                    }
                )
    return pd.DataFrame(rows)


def row(table: pd.DataFrame, metric: str) -> pd.Series:
    return table.set_index("metric").loc[metric]


def test_agents_that_predict_nothing_are_compared_by_what_they_did() -> None:
    """The prediction error has no numbers, the distance those of the construction; and agents are no other planners."""
    agents = runs(0.1).rename(columns={"lookup_spacing": "agent"}).replace({"agent": {0.0: "random", 0.01: "straight"}})
    agents = agents.assign(planner=agents["agent"], prediction_error=np.nan)
    table = comparison.compare(agents, "agent")
    error, distance = row(table, "prediction_error"), row(table, "mean_distance")
    assert np.isnan(error["difference"]) and error[["low", "high"]].isna().all() and error["verdict"] == "not decided"
    assert (distance["a"], distance["b"], distance["verdict"]) == ("random", "straight", "different")
    assert distance["difference"] == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(("shift", "verdict"), [(0.0, "same"), (0.02, "same"), (0.1, "different")])
def test_the_difference_is_that_of_the_construction(shift: float, verdict: str) -> None:
    """By construction: the second value minus the first is `shift`, up to the noise of 0.001."""
    distance = row(comparison.compare(runs(shift), KEY), "mean_distance")
    assert (distance["a"], distance["b"], distance["members"]) == (0.0, 0.01, 8)
    assert distance["difference"] == pytest.approx(shift, abs=0.001)
    assert distance["median_b"] - distance["median_a"] == pytest.approx(shift, abs=0.02)
    assert distance["difference"] == pytest.approx(distance["mean_b"] - distance["mean_a"])
    assert distance["verdict"] == verdict


def test_the_interval_is_scipys_over_members() -> None:
    """Independent: `scipy.stats.bootstrap` of the members' mean differences."""
    table = runs(0.1, members=24)
    distance = row(comparison.compare(table, KEY), "mean_distance")
    means = table.groupby(["member", "lookup_spacing"])["mean_distance"].mean().unstack()
    difference = (means[0.01] - means[0.0]).to_numpy()
    expected = stats.bootstrap((difference,), np.mean, rng=np.random.default_rng(0)).confidence_interval
    assert (distance["low"], distance["high"]) == pytest.approx((expected.low, expected.high))


def test_no_difference_is_a_point_at_zero() -> None:
    """Closed form: equal scores differ by zero, for certain."""
    error = row(comparison.compare(runs(0.1), KEY), "prediction_error")
    assert (error["difference"], error["low"], error["high"], error["verdict"]) == (0, 0, 0, "same")


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(-0.04, 0.04, "same"), (0.01, 0.06, "different"), (-0.06, 0.01, "not decided"), (-0.09, -0.06, "different")],
)
def test_the_verdict_is_that_of_an_equivalence_test(low: float, high: float, expected: str) -> None:
    """By hand, with a margin of 0.05."""
    assert comparison.verdict(low, high, 0.05) == expected


def test_few_members_decide_nothing() -> None:
    """The signed-rank rule of the claims: fewer than 5 members have no interval."""
    distance = row(comparison.compare(runs(0.1, members=4), KEY), "mean_distance")
    assert pd.isna(distance["low"]) and distance["verdict"] == "not decided"
    table = comparison.compare(runs(0.1, members=4), KEY).query("metric == 'mean_distance'")
    (bars,) = contrasts.differences(Figure().subplots(), table, [0.0, 0.01]).containers
    assert bars[0].get_ydata()[0] == pytest.approx(0.1, abs=0.01), "a point without an interval"


def test_one_value_is_nothing_to_compare() -> None:
    with pytest.raises(ValueError, match=r"one value of 'lookup.spacing', 0; there"):
        comparison.compare(runs(0.0).query("lookup_spacing == 0"), KEY)


def test_the_markdown_has_a_row_per_comparison() -> None:
    """By hand: three metrics, a head of two lines; success is a fourth one where runs that arrive can fail."""
    lines = comparison.markdown(comparison.compare(runs(0.1), KEY), KEY).splitlines()
    assert len(lines) == 2 + 3
    failing = comparison.markdown(comparison.compare(runs(0.1).assign(success=False), KEY), KEY).splitlines()
    assert failing[:-1] == lines and "| success (share) |" in failing[-1]
    assert all(line.count("|") == 10 for line in lines)


def test_what_is_drawn_is_the_table() -> None:
    """Points at the differences, bars to the ends of the intervals, the band as wide as the margin."""
    table = comparison.compare(runs(0.1), KEY).query("metric == 'mean_distance'")
    ax = contrasts.differences(Figure().subplots(), table, [0.0, 0.01])
    (bars,) = ax.containers
    found = table.iloc[0]
    assert bars[0].get_ydata().tolist() == [found["difference"]] and bars[0].get_xdata().tolist() == [1.0]
    (segment,) = bars[2][0].get_segments()
    np.testing.assert_allclose(segment[:, 1], [found["low"], found["high"]])
    labels = contrasts.value_axis(ax, ["exact", "0.01"]).get_xticklabels()
    assert [label.get_text() for label in labels] == ["exact", "0.01"]
    band = ax.patches[0].get_extents().transformed(ax.transData.inverted())
    assert (band.y0, band.y1) == pytest.approx((-0.05, 0.05))


def test_several_settings_stand_side_by_side() -> None:
    """A second context size: another place, and a legend that names both."""
    table = comparison.compare(pd.concat([runs(0.1), runs(0.2).assign(context_size=3)]), KEY)
    ax = contrasts.differences(Figure().subplots(), table.query("metric == 'mean_distance'"), [0.0, 0.01])
    places = [bars[0].get_xdata()[0] for bars in ax.containers]
    assert places == pytest.approx([0.925, 1.075])
    assert ax.get_legend_handles_labels()[1] == ["C = 3", "C = 8"]


def test_the_error_of_context_codes_is_the_mean_over_runs() -> None:
    """By construction: equal to the spacing in every run; drawn in the order asked for."""
    ax = contrasts.code_errors(Figure().subplots(), runs(0.0), [0.01, 0.0])
    assert ax.containers[0][0].get_ydata().tolist() == [0.01, 0.0]


@pytest.mark.parametrize(
    ("key", "values", "settings"),
    [
        ("control_layout", ["original", "two_obstacles", "twelve_obstacles"], ["planner", "context_size"]),
        ("model.context_size", [0, 8], ["planner", "layout"]),
    ],
)
def test_any_key_of_the_configuration_can_be_compared(
    write_stages: Callable[..., list[Setting]], tmp_path: Path, key: str, values: list[object], settings: list[str]
) -> None:
    """Names and numbers; by construction the world of two obstacles has distances 0.1 u larger than the original."""
    jobs = write_stages(tmp_path / "stages", (0, 8), members=6, epochs=1, steps=10, experiment="exp2")
    path = build.write(ComparisonReport(tmp_path / "out", jobs, key, **TOLD, notice="NOTICE"))
    name = key.replace(".", "_")
    assert path == tmp_path / "out" / "tables" / f"{name}.md" and path.read_text("utf-8").startswith(
        "# Mine\n\n**NOTICE**\n\n`affmap mine=1`\n"
    )
    assert manifest.problems(tmp_path / "out") == []
    written = {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*")}
    build.write(ComparisonReport(tmp_path / "out", jobs, key, **TOLD, notice="NOTICE"))
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*")} == written
    build.check(ComparisonReport(tmp_path / "out", jobs, key, **TOLD, notice=None))
    with pytest.raises(ConfigError, match="holds no comparison of these results"):
        build.check(ComparisonReport(tmp_path / "out", jobs[1:], key, **TOLD, notice=None))
    plain = ReportSettings.load("report", "default")
    with pytest.raises(ConfigError, match="holds a comparison; say output="):  # a report would replace its tables
        build.write(ExperimentReport(tmp_path / "out", Results(tuple(jobs)), plain, Room(), **TOLD, notice=None))
    assert {file.name for file in (tmp_path / "out" / "figures").iterdir()} == {f"{name}.png", f"{name}.pdf"}
    table = pd.read_csv(tmp_path / "out" / "tables" / f"{name}.csv")
    assert set(table["a"]) == {values[0]} and list(dict.fromkeys(table["b"])) == values[1:]
    assert list(table.columns[: len(settings) + 1]) == [*settings, "metric"]
    assert set(pd.read_csv(tmp_path / "out" / "tables" / "runs.csv")[name]) == set(values)
    assert set(table["metric"]) == {"prediction_error", "mean_distance", "reached"} | (
        {"validation_nll"} if key == "model.context_size" else set()  # else the models are the same
    )
    if key == "model.context_size":
        last = Results(tuple(jobs)).last_epoch.groupby("context_size")["validation_nll"].mean()
        losses = table[table["metric"] == "validation_nll"]
        assert losses["difference"].to_numpy() == pytest.approx(np.full(len(losses), last[8] - last[0]))
    if key == "control_layout":
        farther = table[(table["b"] == "two_obstacles") & (table["metric"] == "mean_distance")]
        assert farther["difference"].to_numpy() == pytest.approx([0.1, 0.1], abs=0.05)


def test_a_key_that_runs_do_not_have_is_refused(write_stages: Callable[..., list[Setting]], tmp_path: Path) -> None:
    jobs = write_stages(tmp_path, (0,), planners=("cem",), members=2, epochs=1, steps=10)
    with pytest.raises(ValueError, match=r"'lookup_spacing', which runs of control do not depend on"):
        ComparisonReport(tmp_path / "out", jobs, "lookup_spacing", **TOLD, notice=None)
