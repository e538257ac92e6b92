"""Whole figures of the arena: affordance maps, worlds, exploration, and moments of runs."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from affmap.env.layout import Layout
from affmap.report.drawing import arena
from affmap.report.drawing.colors import name_of, readable
from affmap.report.figures.files import new_figure
from affmap.results.examples import MAX_ROWS, choose_examples
from affmap.results.examples import rows as rows_of
from affmap.results.files import Floats, Maps
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, Factor, ReportSettings, Setting, Value
from affmap.results.tables import Results

PAPER_SIZE = 8
"""Context size of the paper's affordance maps, in all its experiments."""

NUM_MEMBERS = 6
"""How many members' maps are shown side by side; half as many where there are several worlds."""

NUM_WORLDS = 3
"""How many worlds are shown of a layout whose runs each have a world of their own."""


class Painted(NamedTuple):
    """The maps of one stage."""

    setting: Setting
    maps: Maps
    world: Layout
    radius: float
    """Of the vehicle, u."""


def map_size(results: Results) -> int | None:
    """The context size whose maps are shown: the paper's, else the largest; None where there are no codes."""
    sizes = [size for size in results.context_sizes if size > 0]
    return PAPER_SIZE if PAPER_SIZE in sizes else max(sizes, default=None)


def painted(results: Results, size: int) -> list[Painted]:
    """All maps of a context size, once each, in the order of the layouts."""
    settings = [
        each for layout in results.layouts for each in results.where({CONTEXT_SIZE.key: size, LAYOUT.key: layout})
    ]
    return [_painted(results, setting) for setting in first_settings(settings, "map")]


def _painted(results: Results, setting: Setting) -> Painted:
    maps, world = results.read_maps(setting), results.map_world(setting)
    return Painted(setting, maps, world, results.vehicle_radius(setting))


def first_settings(settings: Iterable[Setting], field: str) -> list[Setting]:
    """The first setting of each value of a field, such as the folder of a stage."""
    first: dict[Any, Setting] = {}
    for setting in settings:
        first.setdefault(getattr(setting, field), setting)
    return list(first.values())


def several_worlds(results: Results) -> list[Painted]:
    """Maps of the worlds that the same models are shown in, those that they were not trained in first; else none."""
    size = map_size(results)
    shown = painted(results, size) if size else []
    if len({part.setting.train for part in shown}) == len(shown) or len({part.world for part in shown}) < len(shown):
        return []
    return sorted(shown, key=lambda part: part.world in results.training_worlds(part.setting))


def paint(parts: list[Painted], index: int) -> list[Floats]:
    """Colour one member's maps: those of the same models in a common basis, others in their own."""
    colors: dict[int, Floats] = {}
    for train in {part.setting.train for part in parts}:
        same = [place for place, part in enumerate(parts) if part.setting.train == train]
        together = arena.paint([(parts[p].maps, parts[p].world) for p in same], parts[same[0]].radius, index)
        colors |= dict(zip(same, together, strict=True))
    return [colors[place] for place in range(len(parts))]


def affordance_maps(results: Results, settings: ReportSettings) -> Figure | None:
    """Maps of several members at one context size in each world, and of one member at every context size."""
    size = map_size(results)
    if size is None:
        return None
    parts = painted(results, size)[:MAX_ROWS]
    count = NUM_MEMBERS if len(parts) == 1 else NUM_MEMBERS // 2
    members = parts[0].maps.member[:count]
    tables = [paint(parts, index) for index in range(len(members))]  # [member][part]
    blocks = [
        (
            f"Members at context size {size}{of_part(results, part, parts, settings)}",
            3,
            [(f"member {m}", tables[index][place], part) for index, m in enumerate(members)],
        )
        for place, part in enumerate(parts)
    ]
    last = parts[-1].setting
    same = {key: last.values[key] for key in (LAYOUT.key, results.color.key) if key not in (results.x.key, PLANNER.key)}
    alike = [setting for value in results.x_values for setting in results.where({**same, results.x.key: value})]
    each = [_painted(results, s) for s in first_settings((s for s in alike if s.context_size > 0), "map")]
    sizes = [(results.x.format(part.setting.values[results.x.key]), paint([part], 0)[0], part) for part in each]
    name = of_part(results, parts[-1], parts, settings, [results.color])
    if results.x == CONTEXT_SIZE or len(each) > 1:
        blocks.append((f"Member {members[0]} at each {results.x.label}{name}", 4, sizes))
    return _map_blocks(blocks)


def of_part(
    results: Results,
    part: Painted,
    parts: list[Painted],
    settings: ReportSettings,
    factors: Sequence[Factor] | None = None,
) -> str:
    """The names of the values that tell a map from the others, after a colon; empty for a single one."""
    told = [
        name_of(factor, part.setting.values[factor.key], settings)
        for factor in factors or dict.fromkeys([LAYOUT, results.color, results.x])
        if len({each.setting.values[factor.key] for each in parts}) > 1
    ]
    return f": {', '.join(told)}" if told else ""


def _map_blocks(blocks: list[tuple[str, int, list[tuple[str, Floats, Painted]]]]) -> Figure:
    """Titled blocks of maps below each other: title, number of columns, and named maps."""
    rows = [-(-len(shown) // columns) for _, columns, shown in blocks]
    heights = [0.55 + 4.95 / columns * num_rows for (_, columns, _), num_rows in zip(blocks, rows, strict=True)]
    figure = new_figure(sum(heights))
    subfigures = figure.subfigures(len(blocks), 1, height_ratios=heights, squeeze=False).ravel()
    for part, (title, columns, shown), num_rows in zip(subfigures, blocks, rows, strict=True):
        part.suptitle(title, x=0.01, ha="left", fontsize=9)
        grid = part.subplots(num_rows, columns, sharex=True, sharey=True, squeeze=False)
        for ax, (name, colors, of) in zip(grid.flat, shown, strict=False):
            arena.affordance_map(ax, colors, of.maps, of.world).set_title(name, loc="left")
            ax.label_outer()
        for ax in grid.ravel()[len(shown) :]:
            ax.set_axis_off()
    return figure


def growth(results: Results, settings: ReportSettings) -> Figure | None:
    """The map of one member after several epochs of a longer training, in one basis."""
    if results.growth is None or results.growth_maps is None or not results.growth_maps.snapshots:
        return None
    world = results.map_world(results.growth)
    snapshots = results.growth_maps.snapshots
    radius = results.vehicle_radius(results.growth)
    colors = arena.paint([(arrays, world) for arrays in snapshots.values()], radius, 0)
    rows = -(-len(snapshots) // 3)
    figure = new_figure(0.4 + 1.65 * rows)
    grid = figure.subplots(rows, 3, sharex=True, sharey=True, squeeze=False)
    for ax, (epoch, arrays), picture in zip(grid.flat, snapshots.items(), colors, strict=False):
        title = f"after {epoch} epoch{'' if epoch == 1 else 's'}"
        arena.affordance_map(ax, picture, arrays, world).set_title(title, loc="left")
        ax.label_outer()
    for ax in grid.ravel()[len(snapshots) :]:
        ax.set_axis_off()
    return figure


def trajectories(results: Results, settings: ReportSettings) -> Figure | None:
    """One moment of a run at either end of the x axis, such as the smallest and the largest context size."""
    chosen = rows_of(results)
    rows = [choose_examples(results, row) for row in chosen]
    columns = max(map(len, rows))
    figure = new_figure(0.7 + (2.55 if columns == 2 or len(rows) > 2 else 4.2) * len(rows))
    grid = figure.subplots(len(rows), columns, squeeze=False)
    flown = []
    for axes, examples, row in zip(grid, rows, chosen, strict=True):
        for ax in axes[len(examples) :]:
            ax.set_axis_off()
        for ax, example in zip(axes, examples, strict=False):
            flown.append(results.worlds(example.setting)[example.problem])
            radius = results.vehicle_radius(example.setting)
            arena.trajectory(ax, example.paths, example.problem, example.step, flown[-1], radius)
            where = f"{row_name(results, row, settings)}, " if len(rows) > 1 else ""
            value = example.setting.values[results.x.key]
            place = name_of(results.x, value, settings) if isinstance(value, str) else f"{results.x.label} {value}"
            ax.set_title(f"{where}{place}, step {example.step}", loc="left")
    handles = grid[0, 0].get_legend_handles_labels()[0] + arena.effect_handles(flown)
    columns = len(handles) if len(handles) <= 6 else -(-len(handles) // 2)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def row_name(results: Results, row: Mapping[str, Value], settings: ReportSettings) -> str:
    """The name of a row of pictures: of its layout, or of the value that colours tell apart."""
    factor = LAYOUT if results.color == PLANNER else results.color
    return name_of(factor, row[factor.key], settings)


def shown_worlds(results: Results, settings: ReportSettings) -> dict[str, Layout]:
    """Title -> the worlds of a report, each once: of training, of control, and of the maps."""
    found: dict[Layout, list[str]] = {}
    for job in first_settings(results.settings, "data"):
        for world in results.training_worlds(job):
            found.setdefault(world, []).append("training")
    for job in first_settings(results.settings, "layout"):
        flown = list(dict.fromkeys(results.worlds(job)))
        for number, world in enumerate(flown[:NUM_WORLDS]):
            found.setdefault(world, []).append("control" if len(flown) == 1 else f"control, run {number}")
    size = map_size(results)
    for part in painted(results, size) if size else []:
        found.setdefault(part.world, []).append("maps")
    return {
        f"{readable(world.name, settings)} ({', '.join(dict.fromkeys(roles))})": world for world, roles in found.items()
    }


def worlds(results: Results, settings: ReportSettings) -> Figure:
    """The layouts."""
    shown = shown_worlds(results, settings)
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure = new_figure(2.6, width=4.0) if len(shown) == 1 else new_figure(0.4 + 5.4 / columns * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (title, world) in zip(grid.flat, shown.items(), strict=False):
        arena.world_map(ax, world, results.vehicle_radius(results.settings[0]))
        if len(shown) > 1:
            ax.set_title(title, loc="left", fontsize=7)
    for ax in grid.ravel()[len(shown) :]:
        ax.set_axis_off()
    if handles := arena.effect_handles(shown.values()):
        figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return figure


def explored(results: Results) -> list[tuple[Floats, Floats, float, Layout]]:
    """Counts, free cells, coverage and world of every training world of every data set."""
    parts: list[tuple[Floats, Floats, float, Layout]] = []
    for job in first_settings(results.settings, "data"):
        data = results.exploration(job)
        parts += zip(data.counts, data.free, data.coverage, results.training_worlds(job), strict=True)
    return parts


def exploration(results: Results, settings: ReportSettings) -> Figure:
    """Where the data sets have been."""
    parts = explored(results)
    columns = min(2, len(parts))
    rows = -(-len(parts) // columns)
    figure = new_figure(2.6, width=4.6) if len(parts) == 1 else new_figure(2.1 * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (counts, free, coverage, world) in zip(grid.flat, parts, strict=False):
        title = f"coverage: {coverage:.1%} of the free cells"
        if len(parts) > 1:
            title = f"{readable(world.name, settings)}: {coverage:.1%} covered"
        arena.visits(ax, counts, free, world).set_title(title, loc="left")
    for ax in grid.ravel()[len(parts) :]:
        ax.set_axis_off()
    return figure
