"""The figures of an experiment's report, a file each: its `draw` selects, draws and captions the figure of its name."""

from importlib import import_module
from pathlib import Path

import matplotlib as mpl

from affmap.report.drawing.files import STYLE, Drawn, save, save_svg
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results
from affmap.store.files import write_json

NAMES = tuple(sorted(path.stem for path in Path(__file__).parent.glob("*.py") if path.stem != "__init__"))
"""Those of the files here."""

CAPTIONS = "captions.json"
"""File beside the figures: name -> caption."""


def draw(name: str, results: Results, settings: ReportSettings) -> Drawn | None:
    """The figure of a name, with its caption; None where results have nothing to show in it."""
    drawn: Drawn | None = import_module(f"{__name__}.{name}").draw(results, settings)
    number = settings.paper_figures.get(name)
    return drawn._replace(caption=f"As the paper's Figure {number}. {drawn.caption}") if drawn and number else drawn


def draw_all(results: Results, settings: ReportSettings, folder: Path, notice: str | None) -> dict[str, str]:
    """Save every figure that the results allow as PNG, PDF and SVG in `folder`; returns name -> caption."""
    folder.mkdir(parents=True, exist_ok=True)
    captions = {}
    with mpl.rc_context(STYLE):
        for name in NAMES:
            if drawn := draw(name, results, settings):
                save(drawn.figure, folder / name, notice)
                save_svg(drawn.figure, folder / f"{name}.svg")
                captions[name] = drawn.caption
    write_json(folder / CAPTIONS, captions)
    return captions
