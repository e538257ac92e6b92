"""Effects of circles on the vehicle: one table for physics, pictures and reports (leaf).

A force in another direction is one more line of it.
"""

from typing import NamedTuple


class Effect(NamedTuple):
    """An effect, its label and its colour."""

    label: str
    """Label in legends."""
    color: str
    """`#rrggbb`."""
    pull: tuple[float, float] | None = None
    """Direction of its pull, x and y; None if it does not pull."""


EFFECTS = {
    "none": Effect("no effect", "#ebebeb"),
    "force_up": Effect("pulls up", "#a1d99b", (0.0, 1.0)),
    "force_down": Effect("pulls down", "#fdae6b", (0.0, -1.0)),
    "fog": Effect("fog", "#9ecae1"),
    "obstacle": Effect("obstacle", "#8c8c8c"),
}
"""Name in `conf/layout` -> effect, from the lowest to the highest where circles overlap in a picture."""

PULLS = {name: effect.pull for name, effect in EFFECTS.items() if effect.pull}
"""Effect -> direction of its pull; where several fields overlap, their pulls add up."""
