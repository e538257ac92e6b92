"""The figures of an experiment's report, and the files that they are saved in."""

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from affmap.report.figures import numbers, pictures
from affmap.report.figures.files import STYLE, save, save_svg
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results

FIGURES: dict[str, Callable[[Results, ReportSettings], Figure | None]] = {
    "results": numbers.main_results,
    "trajectories": pictures.trajectories,
    "maps": pictures.affordance_maps,
    "growth": pictures.growth,
    "world": pictures.worlds,
    "exploration": pictures.exploration,
    "steps": numbers.steps,
    "outcomes": numbers.outcomes,
    "failures": numbers.failures,
}
"""Name of the files -> what draws them."""


def draw_all(results: Results, settings: ReportSettings, folder: Path, notice: str | None) -> list[str]:
    """Draw every figure the results allow, save each as PNG, PDF and SVG in `folder`, and return their names."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    with mpl.rc_context(STYLE):
        for name, draw in FIGURES.items():
            figure = draw(results, settings)
            if figure is not None:
                save(figure, folder / name, notice)
                save_svg(figure, folder / f"{name}.svg")
                names.append(name)
    return names
