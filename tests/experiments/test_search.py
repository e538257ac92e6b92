"""Reports of searches: against a table of trials made by hand."""

import json
from pathlib import Path

import matplotlib.image
import pandas as pd
import pytest
from matplotlib.figure import Figure

from affmap.cli.report import make_report
from affmap.config.search import Search
from affmap.experiments.search import figures as trials
from affmap.experiments.search import report as searches
from affmap.experiments.search.report import SearchReport
from affmap.report import build
from affmap.results import manifest
from affmap.settings import ConfigError

ROWS = [
    (0, "ok", -8.0, 10.0, 0.01, "cem"),
    (1, "fail", None, 10.0, 0.5, "gradient"),
    (2, "ok", -9.0, 10.0, 0.02, "gradient"),
    (3, "ok", -8.7, 12.0, 0.03, "cem"),
    (4, "ok", 500.0, 12.0, 0.9, "cem"),
]
COLUMNS = ["trial", "status", "result", "batch_seconds", "training.lr", "planner"]
IN_USE = {"training.lr": 0.01, "planner": "cem", "seed": 0}


TABLE = pd.DataFrame(ROWS, columns=COLUMNS).to_csv(index=False)


def write(folder: Path, objective: str = "validation_nll", in_use: dict[str, object] = IN_USE) -> str:
    return build.write(report(folder, objective, in_use)).read_text("utf-8")


def report(
    folder: Path, objective: str = "validation_nll", in_use: dict[str, object] = IN_USE, table: str = TABLE
) -> SearchReport:
    return SearchReport(
        folder / "report",
        table,
        objective,
        in_use=in_use,
        log_keys={"training.lr"},
        origin={"git": "abc", "in use": in_use},
        title="A search",
        command="affmap search=mine",
        notice="TOY",
    )


def test_the_best_come_first_and_the_values_in_use_are_placed(tmp_path: Path) -> None:
    """By hand: -9.0, -8.7, -8.0 (in use), 500; one failed; a nat behind is outside the margin of half a nat."""
    text = write(tmp_path)
    assert "**TOY**" in text and "`affmap search=mine`" in text
    assert "5 trials, 1 of which failed. The best, trial 2, has a validation loss of −9.000 nats." in text
    assert "The values in use, trial 0, come in place 3 with a validation loss of −8.000 nats, outside" in text
    rows = [row for row in text.splitlines() if row.startswith("| ")][1:]
    assert [row.split(" | ")[1] for row in rows] == ["2", "3", "0 (in use)", "4"]
    assert rows[0] == "| 1 | 2 | −9.000 | 0.02 | gradient |"


def test_success_is_the_better_the_larger(tmp_path: Path) -> None:
    assert "The best, trial 4, has" in write(tmp_path, "success")


def test_values_in_use_that_were_not_tried_are_not_told(tmp_path: Path) -> None:
    """Another value, and a key that the configuration lacks."""
    for in_use in ({"training.lr": 0.011, "planner": "cem"}, {"planner": "cem"}):
        assert "in use" not in write(tmp_path, in_use=in_use)


def test_a_report_is_that_of_its_trials(tmp_path: Path) -> None:
    """Figures that can be opened, the table as it came; another trial makes it another's."""
    with pytest.raises(ConfigError, match="holds no search of these results"):
        build.check(report(tmp_path))
    write(tmp_path)
    output = tmp_path / "report"
    build.check(report(tmp_path))
    assert manifest.problems(output) == []
    assert manifest.read(output)["git"] == "abc" and manifest.read(output)["objective"] == "validation_nll"
    assert matplotlib.image.imread(output / "figures/search.png").ndim == 3
    assert (output / "tables/trials.csv").read_text() == TABLE
    with pytest.raises(ConfigError, match="holds no search of these results"):
        build.check(report(tmp_path, table=TABLE + "5,ok,1.0,1.0,0.1,cem\n"))


def test_the_origin_of_a_search_names_no_folder_of_the_machine(tmp_path: Path) -> None:
    """Its overrides, configuration and command, of folders given by absolute paths; others are kept."""
    places = [f"output={tmp_path / 'out'}", f"store='{tmp_path / 'my store'}'", "reference=runs/kept/store"]
    search = Search.read(["search=training", "members=1", *places])
    assert search is not None
    record = make_report(search).record
    assert record["overrides"][:3] == ["search=training", "members=1", "reference=runs/kept/store"]
    assert record["config"]["reference"] == "runs/kept/store" and record["config"]["members"] == 1
    assert str(tmp_path) not in json.dumps(record)


def test_what_is_drawn() -> None:
    """Points of complete trials only, one of them beyond the axis; the best so far never rises."""
    ax = Figure().add_subplot()
    trials.history(ax, searches.read(TABLE), "validation_nll", 0)
    lines = {str(line.get_label()): line for line in ax.get_lines()}
    assert set(lines) == {"trial", "beyond the axis", "best", "in use", "best so far"}
    assert sorted([*lines["trial"].get_xdata(), *lines["beyond the axis"].get_xdata()]) == [0, 2, 3, 4]
    assert list(lines["best so far"].get_ydata()) == [-8.0, -9.0, -9.0, -9.0]
    assert list(lines["best"].get_xdata()) == [2] and list(lines["in use"].get_xdata()) == [0]
    low, high = ax.get_ylim()
    assert low < -9.0 and -8.0 < high < 500.0
    assert ax.get_ylabel() == "validation NLL (nats)" and ax.get_xlabel() == "trial"


def test_values_of_keys_are_drawn_on_their_scale() -> None:
    for key, scale in (("training.lr", "log"), ("planner", "linear")):
        ax = trials.by_value(Figure().add_subplot(), searches.read(TABLE), "validation_nll", 0, key, scale == "log")
        assert ax.get_xscale() == scale and ax.get_xlabel() == key


@pytest.mark.parametrize("rows", ["", "0,fail,,1\n"])
def test_a_search_without_results_is_told(rows: str) -> None:
    """No trials; one that failed."""
    with pytest.raises(ConfigError, match="holds no trials with a result; run `affmap`"):
        searches.read(f"trial,status,result,batch_seconds\n{rows}")
