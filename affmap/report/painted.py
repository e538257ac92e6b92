"""The affordance maps that a report shows, and their colours."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from affmap.env.layout import Layout
from affmap.report.drawing import arena
from affmap.report.drawing.colors import name_of
from affmap.results.files import Floats, Maps
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, Factor, ReportSettings, Setting
from affmap.results.tables import Results

PAPER_SIZE = 8
"""Context size of the paper's affordance maps, in all its experiments."""


class Painted(NamedTuple):
    """The maps of one stage."""

    setting: Setting
    maps: Maps
    world: Layout
    radius: float
    """Radius of the vehicle, u."""


def map_size(results: Results) -> int | None:
    """Context size of the maps in a report: the paper's, else the largest; None without codes."""
    sizes = [size for size in results.context_sizes if size > 0]
    return PAPER_SIZE if PAPER_SIZE in sizes else max(sizes, default=None)


def maps_of_size(results: Results, size: int) -> list[Painted]:
    """Maps of a context size, once each, in the order of the layouts."""
    settings = [
        each for layout in results.layouts for each in results.where({CONTEXT_SIZE.key: size, LAYOUT.key: layout})
    ]
    return [read_painted(results, setting) for setting in first_settings(settings, "map")]


def read_painted(results: Results, setting: Setting) -> Painted:
    """Read the maps of a setting."""
    maps, world = results.read_maps(setting), results.map_layout(setting)
    return Painted(setting, maps, world, results.vehicle_radius(setting))


def first_settings(settings: Iterable[Setting], field: str) -> list[Setting]:
    """First setting of each value of a field, such as the folder of a stage."""
    first: dict[Any, Setting] = {}
    for setting in settings:
        first.setdefault(getattr(setting, field), setting)
    return list(first.values())


def several_worlds(results: Results) -> list[Painted]:
    """Maps of the same models in several worlds, worlds that they were not trained in first; empty for one world."""
    size = map_size(results)
    parts = maps_of_size(results, size) if size else []
    if len({part.setting.train for part in parts}) == len(parts) or len({part.world for part in parts}) < len(parts):
        return []
    return sorted(parts, key=lambda part: part.world in results.training_layouts(part.setting))


def paint(parts: list[Painted], index: int) -> list[Floats]:
    """Colour one member's maps: those of the same models in a common basis, others in their own."""
    colors: dict[int, Floats] = {}
    for train in {part.setting.train for part in parts}:
        same = [place for place, part in enumerate(parts) if part.setting.train == train]
        together = arena.paint([(parts[p].maps, parts[p].world) for p in same], parts[same[0]].radius, index)
        colors |= dict(zip(same, together, strict=True))
    return [colors[place] for place in range(len(parts))]


def of_part(
    results: Results,
    part: Painted,
    parts: list[Painted],
    settings: ReportSettings,
    factors: Sequence[Factor] | None = None,
) -> str:
    """Names of the values that distinguish a map from the others, after a colon; empty for a single map."""
    names = [
        name_of(factor, part.setting.values[factor.key], settings)
        for factor in factors or dict.fromkeys([LAYOUT, results.color, results.x])
        if len({each.setting.values[factor.key] for each in parts}) > 1
    ]
    return f": {', '.join(names)}" if names else ""
