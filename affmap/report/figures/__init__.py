"""The figures of an experiment's report, one file each; its `draw` selects the data, draws and captions the figure."""

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from affmap.report.drawing.files import Drawn, save, save_svg, style
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results
from affmap.settings import ConfigError
from affmap.store.files import write_json

CAPTIONS = "captions.json"
"""File beside the figures: name -> caption."""

Draw = Callable[[Results, ReportSettings], Drawn | None]
"""Draws and captions a figure; returns None if the results have nothing to show in it."""


def figures_of(*packages: str) -> dict[str, Draw]:
    """Name -> figure, for all files of some packages.

    Raises:
        ConfigError: a file draws none.
    """
    folders = [(package, import_module(package).__path__) for package in packages]
    modules = [import_module(f"{package}.{each.name}") for package, paths in folders for each in iter_modules(paths)]
    if lacking := [str(module.__file__) for module in modules if not hasattr(module, "draw")]:
        raise ConfigError(f"{lacking[0]} should have a function draw(results, settings), which draws its figure.")
    return {module.__name__.rpartition(".")[2]: module.draw for module in modules}


def draw_all(
    packages: Iterable[str], results: Results, settings: ReportSettings, folder: Path, notice: str | None
) -> dict[str, str]:
    """Save all figures that the results allow, as PNG, PDF and SVG in `folder`; returns name -> caption."""
    folder.mkdir(parents=True, exist_ok=True)
    captions = {}
    with style():
        for name, draw in figures_of(*packages).items():
            if drawn := draw(results, settings):
                save(drawn.figure, folder / name, notice)
                save_svg(drawn.figure, folder / f"{name}.svg")
                number = settings.paper_figures.get(name)
                captions[name] = f"As the paper's Figure {number}. {drawn.caption}" if number else drawn.caption
    write_json(folder / CAPTIONS, captions)
    return captions
