"""Affordance maps of several members at one context size in each world, and of one member at every context size."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from affmap.report.drawing import arena
from affmap.report.drawing.colors import name_of
from affmap.report.drawing.files import Drawn, new_figure
from affmap.report.painted import Painted, first_settings, map_size, maps_of_size, of_part, paint, read_painted
from affmap.results.examples import MAX_ROWS, first_and_last
from affmap.results.files import Floats
from affmap.results.numbers import listed
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, ReportSettings
from affmap.results.tables import Results

NUM_MEMBERS = 6
"""Members whose maps are drawn side by side; half as many with several worlds."""


COLORS = (
    "Red, green and blue are the first three principal components of the codes at reachable positions; constant or "
    "missing components are a neutral grey, so context sizes 1 and 2 use fewer colours. Small differences may be "
    "invisible in three components."
)
"""Meaning of the colours of a map, for captions."""


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None if models have no context codes."""
    size = map_size(results)
    if size is None:
        return None
    every = maps_of_size(results, size)
    parts = first_and_last(every, MAX_ROWS)
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
    each = [read_painted(results, s) for s in first_settings((s for s in alike if s.context_size > 0), "map")]
    names = [name_of(results.x, part.setting.values[results.x.key], settings) for part in each]
    sizes = [(name, paint([part], 0)[0], part) for name, part in zip(names, each, strict=True)]
    name = of_part(results, parts[-1], parts, settings, [results.color])
    if results.x == CONTEXT_SIZE or len(each) > 1:
        blocks.append((f"Member {members[0]} at each {results.x.label}{name}", 4, sizes))
    shown = [part.setting for part in parts]
    left_out = [
        of_part(results, part, every, settings).removeprefix(": ") for part in every if part.setting not in shown
    ]
    return Drawn(_map_blocks(blocks), _caption(results, parts, size, left_out))


def _map_blocks(blocks: list[tuple[str, int, list[tuple[str, Floats, Painted]]]]) -> Figure:
    """Titled blocks of maps below each other: title, number of columns, and named maps."""
    rows = [-(-len(maps) // columns) for _, columns, maps in blocks]
    heights = [
        0.55 + 4.95 / columns * num_rows + 0.35 * (num_rows > 1 and len(maps) % columns > 0)  # axes above empty places
        for (_, columns, maps), num_rows in zip(blocks, rows, strict=True)
    ]
    figure = new_figure(sum(heights))
    subfigures = figure.subfigures(len(blocks), 1, height_ratios=heights, squeeze=False).ravel()
    for part, (title, columns, maps), num_rows in zip(subfigures, blocks, rows, strict=True):
        part.suptitle(title, x=0.01, ha="left", fontsize=9)
        grid = part.subplots(num_rows, columns, sharex=True, sharey=True, squeeze=False)
        for ax, (name, colors, of) in zip(grid.flat, maps, strict=False):
            arena.affordance_map(ax, colors, of.maps.x, of.maps.y, of.world.map).set_title(name, loc="left")
        arena.label_outer(grid, len(maps))
    return figure


def _caption(results: Results, parts: Sequence[Painted], size: int, left_out: Sequence[str]) -> str:
    trainings = len({part.setting.train for part in parts})
    basis = "Colours are comparable within a map, not across maps"
    if trainings < len(parts):
        basis = "Maps of one member in several worlds share their colours; other maps are not comparable"
    each = f", and of one member at each {results.x.label}" if results.x == CONTEXT_SIZE or len(parts) > 1 else ""
    names = listed([f"“{name}”" for name in left_out])
    fewer = f" There is no room for several members of {names}." if left_out else ""
    return (
        f"Affordance maps of several members at context size {size}{each}. {basis}, "
        f"because codes of different members and context sizes are unrelated.{fewer} {COLORS}"
    )
