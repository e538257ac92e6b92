"""A moment of a flight as shapes: what is shown, in which order, colours and proportions.

Painters draw the shapes: `rendering` with pygame, `report.drawing.arena` with Matplotlib, `report/player` in a browser.
Lengths are in u.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from affmap.env.body import THROTTLES
from affmap.env.effects import EFFECTS
from affmap.env.layout import Layout
from affmap.view import EXTENT

NUM_DEVIATIONS = 3
"""Radii of the ellipses along a planned path, in standard deviations."""

SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
CROSS = np.array([[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]])


class Layer(NamedTuple):
    """How a part of a picture looks; its sign (disc, ring, line, cross or square) and its label are for legends."""

    color: str
    width: float = 0.0
    """Of the pen, in points in print and in pixels where a screen has 200 a unit; 0 fills the shape."""
    opacity: float = 1.0
    size: float = 0.0
    """Radius or half the side (u), length of the jet of a fully open throttle (u), or number of deviations."""
    sign: str = ""
    label: str = ""


LAYERS = {
    "view": Layer("#777777", 0.8, size=EXTENT / 2, sign="square", label="what is seen"),
    "candidates": Layer("#969696", 0.5),
    "uncertainty": Layer("#0072b2", 0.5, 0.4, NUM_DEVIATIONS, "ring", f"uncertainty ({NUM_DEVIATIONS} sd)"),
    "times": Layer("#333333", 0.6, 0.6),
    "way": Layer("#cc79a7", 2.0),
    "past": Layer("#000000", 1.3, sign="line", label="past path"),
    "start": Layer("#000000", size=0.03, sign="square", label="start"),
    "plan": Layer("#0072b2", 1.3, sign="line", label="planned path"),
    "steps": Layer("#0072b2", size=0.014),
    "throttles": Layer("#d55e00", 4.0, size=0.12, sign="line", label="throttles"),
    "vehicle": Layer("#2ca02c", sign="disc", label="vehicle"),
    "reach": Layer("#d62728", 0.8),
    "goal": Layer("#d62728", 2.0, size=0.04, sign="cross", label="goal"),
}
"""Part of a moment -> how it looks, from the lowest to the highest; the circles of the world lie below."""


class Mark(NamedTuple):
    """A shape: an ellipse with `radii [2]` around `points [1, 2]`, else a line `[N, 2]`, or what it encloses."""

    layer: Layer
    points: np.ndarray
    radii: np.ndarray | None = None


class Scene(NamedTuple):
    """A moment in a world: a vehicle of some radius, its position and its goal `[2]`, and what else is to be shown."""

    layout: Layout
    radius: float
    position: np.ndarray
    goal: np.ndarray | None
    """None where it flies to nowhere in particular."""
    goal_radius: float = 0.0
    """Distance at which the goal counts as reached; 0 is not shown."""
    action: np.ndarray | None = None
    """`[4]`, opening of the throttles."""
    path: np.ndarray | None = None
    """`[H, 2]`, planned positions; NaN where nothing is expected."""
    std: np.ndarray | None = None
    """`[H, 2]`, their standard deviations."""
    candidates: np.ndarray | None = None
    """`[N, H, 2]`, other paths that were considered."""
    times: Sequence[np.ndarray] = ()
    """Lines of equal times to go, `[points, 2]` each."""
    way: np.ndarray | None = None
    """`[points, 2]`, the way that it follows to its goal."""
    past: np.ndarray | None = None
    """`[T, 2]`, where the vehicle has been, up to now."""
    start: np.ndarray | None = None
    """`[2]`, where it set off."""
    ground: np.ndarray | None = None
    """`[Y, X, 3]` in [0, 1], colours of the ground, on which circles are outlines; row 0 is y = 0."""
    in_fog: bool = False
    """Whether plans start at a noisy position: then no line joins them to the vehicle."""
    view: bool = False
    """Whether to frame the part of the map that the vehicle sees."""

    def marks(self) -> list[Mark]:
        """Shapes, from the lowest to the highest."""
        parts = self.std, self.candidates, self.past, self.action
        std, candidates, past, action = (() if part is None else part for part in parts)
        known = [] if self.path is None else [step for step, point in enumerate(self.path) if np.isfinite(point).all()]
        path = [] if self.path is None else [*self.path[known]]
        deviations = [std[step] for step in known] if len(std) else []
        here, size = self.position, {name: layer.size for name, layer in LAYERS.items()}
        rim, full = self.radius, self.radius + size["throttles"] * np.asarray(action, float)
        shapes: dict[str, list[tuple[Any, ...]]] = {
            "view": [(here + size["view"] * SQUARE,)] if self.view else [],
            "candidates": [([here, *candidate],) for candidate in candidates],
            "uncertainty": [(point, size["uncertainty"] * each) for point, each in zip(path, deviations, strict=False)],
            "times": [(line,) for line in self.times],
            "way": [] if self.way is None else [(self.way,)],
            "past": [(past,)],
            "start": [] if self.start is None else [(self.start + size["start"] * SQUARE,)],
            "plan": [(path if self.in_fog else [here, *path],)],
            "steps": [(point, np.full(2, size["steps"])) for point in path],
            # Jets leave on the side opposite to where they push.
            "throttles": [([here - rim * d, here - end * d],) for d, end in zip(THROTTLES, full, strict=False)],
            "vehicle": [(here, np.full(2, self.radius))],
            "reach": [(self.goal, np.full(2, self.goal_radius))] if self.goal_radius else [],
            "goal": [] if self.goal is None else [(self.goal + size["goal"] * stroke,) for stroke in CROSS],
        }
        marks = circle_marks(self.layout, self.ground is None)
        for name, layer in LAYERS.items():
            looks = [layer]
            if self.ground is not None and layer.width and name not in ("view", "candidates", "times"):
                looks.insert(0, layer._replace(color="#ffffff", width=layer.width + 2))  # whatever the ground's colour
            marks += [Mark(look, np.atleast_2d(points), *radii) for look in looks for points, *radii in shapes[name]]
        return [mark for mark in marks if mark.radii is not None or np.ptp(mark.points, axis=0).any()]


def circle_marks(layout: Layout, filled: bool = True) -> list[Mark]:
    """A world's circles by their effects, the highest last: filled, with arrows where fields pull, or their rims."""
    if not filled:
        each = {name: [circle for circle in layout.circles if circle.effect == name] for name in EFFECTS}
        return [mark for name in EFFECTS for mark in rims(name, [(*one.center, one.radius) for one in each[name]])]
    marks = []
    for name, effect in EFFECTS.items():
        for circle in (circle for circle in layout.circles if circle.effect == name):
            center, radii, pull = np.array([circle.center]), np.full(2, circle.radius), effect.pull
            layers = [Layer(effect.color, opacity=0.5 if pull else 0.85)]  # fields may overlap anything
            layers += [Layer(effect.color, 1.2)] if pull else [Layer("#999999", 0.7)] if name == "none" else []
            marks += [Mark(layer, center, radii) for layer in layers]
            if pull:
                along, aside = 0.6 * circle.radius * np.array([pull, (-pull[1], pull[0])])
                head = center + along
                wings = [head - 0.35 * along + 0.2 * side * aside for side in (1, -1)]
                marks.append(Mark(Layer("#595959", 0.7), np.vstack([center - along, head, wings[0], head, wings[1]])))
    return marks


def rims(name: str, circles: Iterable[tuple[float, float, float]]) -> list[Mark]:
    """Rims of circles (x, y and radius) of an effect, in its colour on white, which covers no colour of another."""
    centers = [(np.array([[x, y]]), np.full(2, radius)) for x, y, radius in circles]
    layers = Layer("#ffffff", 3.5), Layer(EFFECTS[name].color, 2.0)
    return [Mark(layer, *each) for layer in layers for each in centers]
