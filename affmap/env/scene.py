"""A moment of a flight as shapes: what is shown, in which order, colours and proportions.

Painters draw the shapes: `rendering` with pygame, `report.drawing.arena` with Matplotlib, `report/player` in a browser.
Lengths are in u.
"""

from collections.abc import Iterator
from typing import NamedTuple

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
    """How a part of a picture looks."""

    color: str
    """`#rrggbb`."""
    width: float = 0.0
    """Of the pen, in points in print and in pixels where a screen has 200 a unit; 0 fills the shape."""
    opacity: float = 1.0
    size: float = 0.0
    """Radius or half the side of a sign, length of a fully open throttle's jet, or number of deviations."""
    sign: str = ""
    """Its shape in a legend: disc, ring, line, cross or square."""
    label: str = ""
    """Its name there; empty where it needs none."""


LAYERS = {
    "view": Layer("#777777", 0.8, size=EXTENT / 2, sign="square", label="what is seen"),
    "candidates": Layer("#969696", 0.5, sign="line", label="candidates"),
    "uncertainty": Layer("#0072b2", 0.5, 0.4, NUM_DEVIATIONS, "ring", f"uncertainty ({NUM_DEVIATIONS} sd)"),
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
    """A shape: an ellipse where it has radii, else a line or, without a pen, the area that it surrounds."""

    layer: Layer
    points: np.ndarray
    """`[N, 2]`, of the line, or `[1, 2]`, the ellipse's centre."""
    radii: np.ndarray | None = None
    """`[2]`, along x and y."""


class Scene(NamedTuple):
    """A moment in a world."""

    layout: Layout
    radius: float
    """Of the vehicle."""
    position: np.ndarray
    """`[2]`, of the vehicle."""
    goal: np.ndarray
    """`[2]`"""
    goal_radius: float = 0.0
    """Distance at which the goal counts as reached; 0 does not show it."""
    action: np.ndarray | None = None
    """`[4]`, opening of the throttles."""
    path: np.ndarray | None = None
    """`[H, 2]`, planned positions; NaN where nothing is expected."""
    std: np.ndarray | None = None
    """`[H, 2]`, their standard deviations."""
    candidates: np.ndarray | None = None
    """`[N, H, 2]`, other paths that were considered."""
    past: np.ndarray | None = None
    """`[T, 2]`, where the vehicle has been, up to now."""
    start: np.ndarray | None = None
    """`[2]`"""
    ground: np.ndarray | None = None
    """`[Y, X, 3]` in [0, 1], colours of the ground, on which circles are outlines; row 0 is y = 0."""
    in_fog: bool = False
    """Whether plans start at a noisy position: then no line joins them to the vehicle."""
    view: bool = False
    """Whether to frame the part of the map that the vehicle sees."""

    def marks(self) -> list[Mark]:
        """Shapes, from the lowest to the highest."""
        here, layers = self.position, LAYERS
        path = np.empty((0, 2)) if self.path is None else self.path[np.isfinite(self.path).all(1)]
        radii = () if self.std is None else layers["uncertainty"].size * self.std[np.isfinite(self.std).all(1)]
        candidates = () if self.candidates is None else self.candidates
        shapes: dict[str, list[tuple[np.ndarray, float | np.ndarray | None]]] = {
            "view": [(here + layers["view"].size * SQUARE, None)] if self.view else [],
            "candidates": [(np.vstack([here, *candidate]), None) for candidate in candidates],
            "uncertainty": list(zip(path, radii, strict=False)),
            "past": [] if self.past is None else [(self.past, None)],
            "start": [] if self.start is None else [(self.start + layers["start"].size * SQUARE, None)],
            "plan": [(path if self.in_fog else np.vstack([here, path]), None)] if len(path) else [],
            "steps": [(point, layers["steps"].size) for point in path],
            "throttles": [(jet, None) for jet in self._jets()],
            "vehicle": [(here, self.radius)],
            "reach": [(self.goal, self.goal_radius)] if self.goal_radius else [],
            "goal": [(self.goal + layers["goal"].size * stroke, None) for stroke in CROSS],
        }
        marks = circle_marks(self.layout, self.ground is None)
        for name, layer in layers.items():
            looks = [layer]
            if self.ground is not None and layer.width and name not in ("view", "candidates"):
                looks.insert(0, layer._replace(color="#ffffff", width=layer.width + 2))  # whatever the ground's colour
            for look in looks:
                marks += [
                    Mark(look, np.atleast_2d(points), None if radii is None else np.broadcast_to(radii, 2))
                    for points, radii in shapes[name]
                    if radii is not None or len(points) > 1  # a flight begins without a past
                ]
        return marks

    def _jets(self) -> Iterator[np.ndarray]:
        """Lines `[2, 2]` from the vehicle's rim, on the side opposite to where an open throttle pushes."""
        for direction, opening in zip(THROTTLES, () if self.action is None else self.action, strict=False):
            if opening > 0:
                ends = self.radius + np.array([[0.0], [LAYERS["throttles"].size * opening]])
                yield self.position - ends * direction


def circle_marks(layout: Layout, filled: bool = True) -> list[Mark]:
    """A world's circles by their effects, the highest last: filled, with arrows where fields pull, or their rims."""
    marks = []
    for name, effect in EFFECTS.items():
        for circle in (circle for circle in layout.circles if circle.effect == name):
            center, radii, pull = np.array([circle.center]), np.full(2, circle.radius), effect.pull
            layers = [Layer("#ffffff", 3.0), Layer(effect.color, 1.5)]
            if filled:  # fields may overlap anything
                layers = [Layer(effect.color, opacity=0.5 if pull else 0.85)]
                layers += [Layer(effect.color, 1.2)] if pull else [Layer("#999999", 0.7)] if name == "none" else []
            marks += [Mark(layer, center, radii) for layer in layers]
            if filled and pull:
                along, aside = 0.6 * circle.radius * np.array([pull, (-pull[1], pull[0])])
                head = center + along
                wings = [head - 0.35 * along + 0.2 * side * aside for side in (1, -1)]
                marks.append(Mark(Layer("#595959", 0.7), np.vstack([center - along, head, wings[0], head, wings[1]])))
    return marks
