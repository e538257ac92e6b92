"""Checks of interpolations, such as `map_layout: ${world}`, before OmegaConf resolves them.

A configuration is composed anew by each command and each job, and has to say the same every time. So its keys may refer
to other keys and to environment variables, but call none of the functions that Hydra and OmegaConf offer (`now`, for
one). Hydra's own keys, which name folders of logs, may call them.
"""

import re
from collections.abc import Iterator
from typing import Any

from omegaconf import OmegaConf

from affmap.settings.messages import ConfigError, format_value

KEY = re.compile(r"\$\{\s*(\.*)([^{}$:]+)\}")
"""An interpolation of another key: dots for one that is relative, and the key."""
ENVIRONMENT = re.compile(r"\$\{\s*oc\.env\s*:[^{}$]*\}")
"""An interpolation of an environment variable."""
FIXED = re.compile(r"hydra\.runtime\.(cwd$|choices\.)")
"""Hydra's own keys that stay the same."""

MOST_EXPANDED = 10_000
"""Most values and characters that interpolations may stand for: interpolations of interpolations multiply."""

COPIES = ("hydra.overrides.task", "hydra.overrides.hydra", "hydra.job.override_dirname")
"""Hydra's copies of the command line."""

Place = tuple[str, ...]


def check(composed: Any) -> None:
    """Make sure that a composed configuration stays the same, and that it does not explode.

    Raises:
        ConfigError: a value may be another the next time, or interpolations stand for too much.
    """
    tree = _as_mappings(OmegaConf.to_container(composed))
    copies = {f"${{{key}}}" for key in COPIES}
    texts = {place: text for place, text in _texts(tree) if ".".join(place[:3]) not in COPIES and text not in copies}
    for place, text in texts.items():
        if place[0] != "hydra" and not _is_constant(text):
            raise ConfigError(
                f"{'.'.join(place)} = {format_value(text)} may be another value each time it is read; write the value "
                "itself. It may only refer to other keys, as in ${world}, and to the environment, as in ${oc.env:HOME}."
            )
    sizes: dict[Place, int] = {}
    expanded = {place: _size(tree, place, sizes) - len(text) for place, text in texts.items()}
    if sum(expanded.values()) > MOST_EXPANDED:
        worst = max(expanded, key=lambda place: expanded[place])
        raise ConfigError(
            f"{'.'.join(worst)} = {format_value(texts[worst])} refers to keys that refer to others and stands for more "
            f"than {MOST_EXPANDED} values or characters in the end; write the value itself."
        )


def refers_to_keys_only(text: str) -> bool:
    """Whether a text reads nothing else than other keys, environment variables in particular."""
    return "${" not in KEY.sub("", text)


def _is_constant(text: str) -> bool:
    places = [_parts(key) for _, key in KEY.findall(text)]
    changing = [place for place in places if place[:1] == ["hydra"] and not FIXED.match(".".join(place))]
    return not changing and refers_to_keys_only(ENVIRONMENT.sub("", text))


def _parts(key: str) -> list[str]:
    """The parts of a key, written with dots or with brackets."""
    return re.findall(r"[^.\[\]\s]+", key)


def _as_mappings(value: Any) -> Any:
    """A copy of nested mappings and lists in which lists are mappings, too, and all keys are texts."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    return value if items is None else {str(key): _as_mappings(part) for key, part in items}


def _texts(value: Any, place: Place = ()) -> Iterator[tuple[Place, str]]:
    """Texts that refer to something, and their places."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _texts(part, (*place, key))
    elif isinstance(value, str) and "${" in value:
        yield place, value


def _size(tree: Any, place: Place, sizes: dict[Place, int]) -> int:
    """Number of values and characters at a place when its interpolations are resolved."""
    if place not in sizes:
        sizes[place] = 0  # of a text that refers to itself, which OmegaConf reports
        value = tree
        for depth, part in enumerate(place):
            if isinstance(value, str):  # it refers to a mapping, in which the rest of the place is
                sizes[place] = _size(tree, place[:depth], sizes)
                return sizes[place]
            value = value.get(part) if isinstance(value, dict) else None
        targets: list[Place] = []
        if isinstance(value, dict):
            targets = [(*place, key) for key in value]
        elif isinstance(value, str):
            for dots, key in KEY.findall(value):
                start = place[: -len(dots)] if dots else ()
                targets.append((*start, *_parts(key)))
        own = len(value) if isinstance(value, str) else 1
        sizes[place] = own + sum(_size(tree, target, sizes) for target in targets)
    return sizes[place]
