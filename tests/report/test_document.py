"""References: the bytes of a second write, hand-computed box plots, the notice's red in what was drawn."""

import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
import typst
from matplotlib.figure import Figure

from affmap.report import Job, captions, claims, document, figures, panels, write
from affmap.report.tables import Results, Trajectories

NOTICE = "SMOKE RUN: 2 members, 2 epochs; not a result"
WriteStages = Callable[..., list[Job]]
TITLE, COMMAND = "Experiment I: obstacle avoidance", "make exp1 SCALE=smoke"


@pytest.fixture(scope="module")
def jobs(write_stages: WriteStages, tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    return write_stages(tmp_path_factory.mktemp("stages"), (0, 8), members=2, epochs=2)


@pytest.fixture(scope="module")
def report(jobs: list[Job], tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("report")
    assert write(output, jobs, title=TITLE, command=COMMAND, notice=NOTICE) == output / "report.pdf"
    return output


def test_everything_that_was_promised_is_there(report: Path) -> None:
    tables = {f"tables/{name}" for name in ("runs.csv", "validation.csv", "claims.csv", "medians.csv", "claims.md")}
    drawn = {f"figures/{name}.{kind}" for name in figures.FIGURES for kind in ("png", "pdf")}
    files = {path.relative_to(report).as_posix() for path in report.rglob("*") if path.is_file()}
    assert files == tables | drawn | {"report.pdf", "provenance.json"}
    assert len(pd.read_csv(report / "tables" / "runs.csv")) == 2 * 2 * 2 * 4


def test_writing_twice_gives_the_same_bytes(report: Path, jobs: list[Job], tmp_path: Path) -> None:
    again = tmp_path / report.name
    write(again, jobs, title=TITLE, command=COMMAND, notice=NOTICE)
    for path in report.rglob("*.*"):
        assert path.read_bytes() == (again / path.relative_to(report)).read_bytes(), path.name


def test_a_complete_report_is_left_alone(report: Path, jobs: list[Job]) -> None:
    """A file removed by hand stays away as long as stages, arguments and code are the same."""
    table = report / "tables" / "medians.csv"
    content = table.read_bytes()
    table.unlink()
    write(report, jobs, title=TITLE, command=COMMAND, notice=NOTICE)
    assert not table.exists()
    (report / "provenance.json").unlink()
    write(report, jobs, title=TITLE, command=COMMAND, notice=NOTICE)
    assert table.read_bytes() == content


def test_the_notice_is_red_on_every_figure(report: Path) -> None:
    for path in report.glob("figures/*.png"):
        assert _red_pixels(path.read_bytes(), rows=60) > 500, path.name


def test_the_notice_is_red_at_the_head_of_the_document(tmp_path: Path) -> None:
    heads = {}
    for notice in ("", NOTICE):
        template = Path(document.__file__).with_name("report.typ").read_bytes()
        compiler = typst.Compiler(template, root=tmp_path, sys_inputs={"data": json.dumps(_empty_document(notice))})
        page = compiler.compile(format="png", ppi=72)
        heads[notice] = _red_pixels(page[0] if isinstance(page, list) else page, rows=150)
    assert heads[""] == 0 and heads[NOTICE] > 100


def test_the_document_has_pages(report: Path) -> None:
    pdf = (report / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    count = re.search(rb"/Type/Pages/Count (\d+)", pdf)
    assert count is not None and int(count.group(1)) >= 3


def test_the_markdown_table_has_a_row_per_part(report: Path) -> None:
    lines = (report / "tables" / "claims.md").read_text("utf-8").splitlines()
    assert len(lines) == 2 + 7 + 5
    assert all(line.count("|") == 7 for line in lines)
    assert all("not decided" in line for line in lines[2:]), "two members decide nothing"


def test_provenance_lists_each_stage_once_and_only_what_differs(report: Path) -> None:
    origin = json.loads((report / "provenance.json").read_text("utf-8"))
    assert len(origin["stages"]) == 1 + 2 + 2 + 4
    assert origin["seconds"] == pytest.approx(9 * 12.5)
    assert origin["versions"] == [{"affmap": "0.1.0", "torch": "2.13.0", "numpy": "2.4.6"}]
    trained = {stage["digest"]: stage["differs"] for stage in origin["stages"] if stage["stage"] == "train"}
    assert trained == {"t0": {}, "t8": {"model.context_size": 8}}


@pytest.mark.parametrize(("sizes", "planners"), [((0,), ("cem",)), ((3,), ("gradient",))])
def test_a_part_of_the_settings_is_enough(
    write_stages: WriteStages, tmp_path: Path, sizes: tuple[int, ...], planners: tuple[str, ...]
) -> None:
    jobs = write_stages(tmp_path / "stages", sizes, planners, members=2, epochs=1)
    assert write(tmp_path / "out", jobs, title=TITLE, command=COMMAND, notice=None).exists()
    assert (tmp_path / "out" / "figures" / "figure5.png").exists() == ("cem" in planners)
    assert (tmp_path / "out" / "figures" / "maps.png").exists() == (max(sizes) > 0)


def test_captions_state_the_verdicts_of_the_data(write_stages: WriteStages, tmp_path: Path) -> None:
    results = Results(tuple(write_stages(tmp_path, (0, 1, 8), members=6)))
    scores = claims.score(results)
    assert "claim I-1 holds" in captions.captions(results, scores)["figure4"]
    assert "8 hold (I-1" in captions.verdict_count(scores)
    results.last_epoch["validation_nll"] *= -1
    scores = claims.score(results)
    assert "claim I-1 does not hold" in captions.captions(results, scores)["figure4"]
    assert "1 does not hold (I-1)" in captions.verdict_count(scores)


def test_box_plots_are_the_papers() -> None:
    """1 to 8 and an outlier: quartiles 3 and 7, whiskers to 1 and 8 (limits -3 and 13), no point at 90."""
    values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 90.0]
    runs = pd.DataFrame({"context_size": 0, "planner": "cem", "mean_distance": values})
    ax = panels.boxes(Figure().subplots(), runs, "mean_distance")
    box = np.asarray(ax.patches[0].get_path().vertices)[:, 1]
    assert (box.min(), box.max()) == (3.0, 7.0)
    drawn = np.concatenate([np.asarray(line.get_ydata()) for line in ax.lines])
    assert set(drawn) == {1.0, 3.0, 5.0, 7.0, 8.0}, "whisker ends, quartiles and the median, no outlier"


def test_half_way_is_the_first_step_with_half_of_the_distance_left() -> None:
    position = np.zeros((1, 6, 2))
    position[0, :, 0] = [0.0, 0.3, 0.6, 0.4, 0.9, 1.0]
    plans = np.zeros((1, 5, 20, 2))
    paths = Trajectories(position, np.array([[1.0, 0.0]]), plans, plans, np.zeros(1, int), np.zeros(1, int))
    assert figures._half_way(paths, 0) == 2
    stuck = paths._replace(position=position * 0.4)
    assert figures._half_way(stuck, 0) == 4, "never half way: the closest step that has a plan"


def test_the_example_is_the_lower_median_run_of_the_first_member(jobs: list[Job]) -> None:
    results = Results(tuple(jobs))
    runs = results.runs.query("planner == 'cem' and member == 0")
    order = runs.groupby("run")["mean_distance"].mean().sort_values().index
    examples = figures.choose_examples(results)
    assert [example.context_size for example in examples] == [0, 8]
    assert {(example.member, example.run) for example in examples} == {(0, order[1])}


def _red_pixels(png: Any, rows: int) -> int:
    top = matplotlib.image.imread(io.BytesIO(png))[:rows, :, :3]
    return int(((top[..., 0] > 0.9) & (top[..., 1:] < 0.4).all(axis=-1)).sum())


def _empty_document(notice: str) -> dict[str, Any]:
    lists = ("changes", "findings", "costs", "claims", "context_sizes", "medians", "provenance", "stages")
    texts = ("count", "setting", "rule", "ranges", "deviations")
    empty: dict[str, Any] = {name: [] for name in lists} | dict.fromkeys(texts, "")
    return {"title": TITLE, "notice": notice, "figures": {}} | empty
