"""Effects of circles on the vehicle: one table for physics, pictures and reports, to which users may add (leaf).

A force in another direction is one more line of it.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from affmap.settings import NAME, ConfigError, extensions
from affmap.settings.messages import OWN, format_value

Force = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Force of a circle on the vehicle, see `Effect`."""


@dataclass(frozen=True)
class Effect:
    """The effect of a kind of circles on the vehicle; `register_effect` makes it known.

    Attributes:
        label: in legends.
        color: `#rrggbb`.
        pull: direction of its pull, x and y; None if it does not pull.
        force: any other force: a function of the way from the circle's centre to that of the vehicle (u) and of the
            vehicle's velocity (u/s), `[..., 2]` each, that returns `[..., 2]` in N; None if there is none.
    """

    label: str
    color: str
    pull: tuple[float, float] | None = None
    force: Force | None = None


EFFECTS = {
    "none": Effect("no effect", "#ebebeb"),
    "force_up": Effect("pulls up", "#a1d99b", (0.0, 1.0)),
    "force_down": Effect("pulls down", "#fdae6b", (0.0, -1.0)),
    "fog": Effect("fog", "#9ecae1"),
    "key": Effect("key", "#f0c808"),
    "door": Effect("door", "#a0522d"),
    "obstacle": Effect("obstacle", "#8c8c8c"),
}
"""Name in `conf/layout` -> effect, from the lowest to the highest where circles overlap in a picture."""

SOLID = frozenset({"obstacle", "door"})
"""Effects that block the way; a door does until a key has been visited."""

INERT = frozenset({"none", "key"})
"""Effects that move nothing; a key opens all doors of its layout, for good."""

_OURS = frozenset(EFFECTS)

_HIGHEST = ("fog", "key", "door", "obstacle")
"""Effects that lie above all others in pictures."""


def register_effect(name: str, effect: Effect) -> None:
    """Make an effect known to layouts, by its name.

    Its circles look and act as others do. A `pull` acts everywhere, times `vehicle.force`. A `force` is Python: agents
    that imagine with the true physics (`oracle`, `true_mean`, `true_deviation`), which is compiled, do not know it.

    Args:
        name: the `effect` of circles in layouts.
        effect: its label, its colour, and how it acts.

    Raises:
        ValueError: the name is taken, or the effect is none, or a value is not allowed.
    """
    if not isinstance(effect, Effect):
        raise ValueError(
            f"the effect {format_value(name)} is {format_value(effect)}; give affmap.Effect(label, color), with a pull "
            "or a force, such as affmap.Effect('whirls', '#e6c27a', force=whirl)."
        )
    if not re.fullmatch(NAME, str(name)) or name in _OURS:
        raise ValueError(f"the effect {format_value(name)} needs a name of its own, of letters, digits and _.")
    if not effect.label or not re.fullmatch("#[0-9a-fA-F]{6}", str(effect.color)):
        raise ValueError(
            f"the effect {name!r} needs a label, and a colour such as '#c994c7'; it has {effect.label!r} and "
            f"{effect.color!r}."
        )
    if effect.pull is not None and effect.force is not None:
        raise ValueError(f"the effect {name!r} has a pull and a force; give it one of them, a force can do both.")
    if effect.pull is not None and not (len(effect.pull) == 2 and np.isfinite(effect.pull).all()):
        raise ValueError(f"the effect {name!r} has pull = {effect.pull!r}; it should be a direction, x and y.")
    if effect.force is not None:
        force_at(name, effect.force, np.zeros((3, 2)), np.zeros((3, 2)))
    extensions.note("effect", name, sys._getframe(1).f_globals["__name__"])  # effects do not know their module
    above = {key: EFFECTS.pop(key) for key in _HIGHEST}
    EFFECTS.pop(name, None)
    EFFECTS.update({name: effect, **above})


def check_effect(name: str) -> str:
    """Return the name of an effect, if there is one.

    Raises:
        ValueError: there is none.
        ConfigError: a module that the user named cannot be imported.
    """
    if name not in EFFECTS:
        extensions.load()
    if name not in EFFECTS:
        raise ValueError(f"should be one of {', '.join(map(repr, EFFECTS))}; {OWN}")
    return name


def force_at(name: str, force: Force, offset: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """The force of a circle, `[..., 2]` in N; arguments as in `Force`.

    Raises:
        ConfigError: it has another shape, or is not finite.
    """
    value = np.asarray(force(offset, velocity), float)
    if value.shape != offset.shape or not np.isfinite(value).all():
        raise ConfigError(
            f"the force of the effect {name!r} returned shape {list(value.shape)}, or numbers that are not finite; it "
            f"should return finite numbers of shape {list(offset.shape)}, as its arguments have."
        )
    return value


def pulls() -> dict[str, tuple[float, float]]:
    """Effect -> direction of its pull; where several fields overlap, their pulls add up."""
    return {name: effect.pull for name, effect in EFFECTS.items() if effect.pull}


def check_compiled(effects: Iterable[str]) -> None:
    """Make sure that the compiled physics knows effects.

    Raises:
        ConfigError: one is a force in Python.
    """
    if unknown := [name for name in effects if EFFECTS[name].force]:
        raise ConfigError(
            f"the effect {unknown[0]!r} is a force in Python, which agents that imagine with the true physics do not "
            "know; leave them out, of baselines as well: baselines=[straight,random]."
        )
