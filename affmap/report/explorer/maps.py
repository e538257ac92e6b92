"""Affordance maps whose codes are shown under the pointer. Knows results; `explorer.js` draws."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.image import imsave

from affmap.report.drawing.colors import name_of, readable
from affmap.report.packing import pack
from affmap.report.painted import Painted, map_size, maps_of_size, paint
from affmap.report.player.runs import CODE, describe
from affmap.results.files import Floats
from affmap.results.setting import ALWAYS, Factor, ReportSettings
from affmap.results.tables import Results

SPACING = 0.04
"""Spacing of the nodes whose codes are in the page, u; the picture has all nodes."""


def explorer(results: Results, settings: ReportSettings) -> dict[str, Any] | None:
    """Variables of `explorer.html`: maps of the first member, of every context size and world; None without codes."""
    maps = []
    for size in filter(None, results.context_sizes):
        parts = maps_of_size(results, size)
        factors = [f for f in dict.fromkeys([results.color, results.x]) if f not in ALWAYS and _differ(parts, f)]
        maps += [_map(part, colors, factors, settings) for part, colors in zip(parts, paint(parts, 0), strict=True)]
    if not maps:
        return None
    spacing = maps[0]["spacing"][0]
    caption = (
        "Affordance maps of the first member, coloured as in the figure of maps. Point at a map, or move with the "
        f"arrow keys: the bars show the context code at the nearest node (spacing {spacing:.2g} u). Codes lie between "
        "−1 and 1; codes of different models are unrelated."
    )
    first = next(place for place, entry in enumerate(maps) if entry["choice"][1] == str(map_size(results)))
    data = {"first": first, "keys": ["World", "Context size"], "maps": maps}
    return {"data": data, "caption": caption}


def _differ(parts: Sequence[Painted], factor: Factor) -> bool:
    """Whether maps have different values of a factor."""
    return len({part.setting.values[factor.key] for part in parts}) > 1


def _name(factor: Factor, part: Painted, settings: ReportSettings) -> str:
    return name_of(factor, part.setting.values[factor.key], settings)


def _map(part: Painted, colors: Floats, factors: Sequence[Factor], settings: ReportSettings) -> dict[str, Any]:
    """Map of the first member: its picture `[Y, X, 3]`, and the codes at every n-th node."""
    axes = np.array([(nodes[0], nodes[-1], nodes[1] - nodes[0]) for nodes in (part.maps.x, part.maps.y)])
    first, last, pitch = axes.T  # x and y each, u
    stride = max(1, round(SPACING / float(pitch[0])))
    picture = io.BytesIO()
    unsigned: Any = {"Software": None}  # the same bytes by any version of Matplotlib
    imsave(picture, colors, origin="lower", format="png", metadata=unsigned)
    return {
        "choice": [
            ", ".join([readable(part.world.name, settings), *(_name(f, part, settings) for f in factors)]),
            str(part.setting.context_size),
        ],
        "world": describe(part.world, part.radius),
        "picture": f"data:image/png;base64,{base64.b64encode(picture.getvalue()).decode('ascii')}",
        "edges": [(first - pitch / 2).tolist(), (last + pitch / 2).tolist()],  # a node is in the middle of its pixel
        "origin": first.tolist(),
        "spacing": (stride * pitch).round(9).tolist(),
        "codes": pack(part.maps.codes[0, ::stride, ::stride], CODE),
    }
