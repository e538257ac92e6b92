"""Bytes of reports: the same whoever draws them, in processes with nothing in common but the stages."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import seaborn as sns
import stage_files
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from affmap.report import build
from affmap.report.drawing import files
from affmap.report.experiment import ExperimentReport, Room
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results

MATPLOTLIBRC = """
text.usetex: True
font.size: 30
font.family: serif
axes.formatter.use_locale: True
axes.grid: True
figure.autolayout: True
savefig.bbox: tight
savefig.transparent: True
svg.fonttype: none
svg.hashsalt: mine
pdf.compression: 0
image.origin: lower
timezone: Asia/Tokyo
"""
"""A user's settings, the first of which needs LaTeX."""


def report(stages: Path, output: Path) -> None:
    """Write the report of one setting, whose stages are written where they are missing."""
    settings = stage_files.write_stages(stages, (8,), ("cem",), members=1, epochs=1, steps=2)
    about = {"name": "mine", "title": "Mine", "command": "affmap", "notice": "TOY"}
    look = ReportSettings.load("report", "default")
    build.write(ExperimentReport(output, Results(tuple(settings)), look, Room(), **about))


def contents(folder: Path) -> dict[str, bytes]:
    """Name -> bytes of every file."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def changed(one: Path, other: Path) -> list[str]:
    """Names of the files that differ."""
    files, others = contents(one), contents(other)
    assert len(files) > 20
    return sorted(name for name in files.keys() | others.keys() if files.get(name) != others.get(name))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same report in `1` and `2`, by fresh processes, the second of which has other settings in every respect."""
    root = tmp_path_factory.mktemp("drawn")
    (root / "matplotlibrc").write_text(MATPLOTLIBRC)
    stage_files.write_stages(root / "stages", (8,), ("cem",), members=1, epochs=1, steps=2)
    strange = {"MATPLOTLIBRC": str(root / "matplotlibrc"), "MPLBACKEND": "svg", "LC_ALL": "C", "COLUMNS": "20"}
    strange |= {"HOME": str(root), "MPLCONFIGDIR": str(root / "none"), "TZ": "Asia/Tokyo"}
    processes = []
    for number, own in (("1", {}), ("2", strange)):
        threads = dict.fromkeys(("PYTHONHASHSEED", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), number)
        variables = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **threads, **own}
        command = [sys.executable, __file__, str(root / "stages"), str(root / number)]
        processes.append(subprocess.Popen(command, env=variables))
    assert [process.wait(120) for process in processes] == [0, 0]
    return root


def test_fresh_processes_with_other_settings_write_the_same_bytes(
    drawn: Path, tried: Callable[[str, int, str], None]
) -> None:
    """Other hash seeds, threads, locales, time zones, a home without a font cache, and a `matplotlibrc` with LaTeX."""
    assert changed(drawn / "1", drawn / "2") == []
    tried("a report by fresh processes with other hash seeds, threads, locales and styles", 2, "the same bytes")


def test_neither_a_notebook_nor_the_last_digits_of_a_layout_get_into_reports(
    drawn: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Settings of Matplotlib, seaborn, pandas and NumPy; roundings of the solver, which adds by addresses in memory."""
    execute, rng = ConstrainedLayoutEngine.execute, np.random.default_rng(0)

    def noisy(self: ConstrainedLayoutEngine, figure: Figure) -> None:
        execute(self, figure)
        for ax in figure.axes:
            bounds = np.array(ax.get_position(original=True).bounds)
            ax.set_position((bounds * (1 + rng.normal(0, 1e-15, 4))).tolist())
            ax.set_in_layout(True)
        for part in figure.subfigs:
            points = part.bbox_relative.get_points()
            part.bbox_relative.set_points(points * (1 + rng.normal(0, 1e-15, points.shape)))

    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", noisy)
    display = pd.option_context(
        {"display.precision": 1, "display.max_rows": 2, "display.float_format": "{:.0f}".format}
    )
    with mpl.rc_context(), display, np.printoptions(precision=1, threshold=2):
        sns.set_theme("poster", "darkgrid", "dark", "serif", 3.0)
        mpl.rcParams.update(mpl.rc_params_from_file(drawn / "matplotlibrc", use_default_template=False))
        report(drawn / "stages", drawn / "3")
    assert changed(drawn / "1", drawn / "3") == []


@pytest.mark.parametrize("place", ["outside upper right", "outside lower center"])
def test_a_notice_lies_over_no_legend(tmp_path: Path, place: str) -> None:
    """By the extents of what is drawn; the legend is also clear of the panels."""
    figure = files.new_figure(2.0)
    ax = figure.subplots()
    ax.plot([0, 1], label="a curve with a name as long as a notice")
    legend = figure.legend(loc=place, ncols=1)
    files.save(figure, tmp_path / "figure", "TOY: every stage at toy size; the numbers mean nothing")
    (notice,) = figure.texts
    entry = legend.get_window_extent()
    assert not notice.get_window_extent().overlaps(entry)
    assert not ax.get_tightbbox().overlaps(entry)


def test_dollars_are_dollars_but_for_powers_on_logarithmic_axes(tmp_path: Path) -> None:
    """A broken formula in every place for text, and a scale of powers of ten."""
    broken, figure = r"$\frac{x$ $", files.new_figure(3.0)
    left, right = figure.subplots(1, 2)
    left.plot([1, 2], [1.0, 1e6], label=f"a{broken}")
    left.set(yscale="log", title=broken, xlabel=broken, ylabel=broken)
    left.set_xticks([1, 2], [broken, "b"])
    left.legend(title=broken)
    right.bar([broken, "c"], [1, 2])
    figure.suptitle(broken)
    files.save(figure, tmp_path / "figure", broken)
    files.save_svg(figure, tmp_path / "figure.svg")
    assert {path.suffix for path in tmp_path.iterdir()} == {".png", ".pdf", ".svg"}
    assert all(label.get_parse_math() for label in left.get_yticklabels())
    texts = [*left.get_xticklabels(), *right.get_xticklabels(), left.title, *left.get_legend().get_texts()]
    assert not any(text.get_parse_math() for text in texts)


if __name__ == "__main__":
    report(Path(sys.argv[1]), Path(sys.argv[2]))
