"""The validated configurations of many jobs: Hydra composes what they share, and the differences are filled in.

Hydra takes a tenth of a second for a configuration, and the jobs of a sweep mostly differ in a few numbers. Groups and
whatever else is not a plain value of a known key are left to Hydra, once for each combination of them. An invalid
configuration is composed and validated by itself, so that errors read as for a single job.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from itertools import product
from typing import Any, NamedTuple

from hydra.core.override_parser.types import Override, OverrideType, QuotedString, Transformer
from omegaconf import OmegaConf

from affmap.config import memory
from affmap.config.compose import check, check_launch, compose, launch_settings, values
from affmap.config.root import Config
from affmap.settings import ConfigError, folders

PLAIN = re.compile(r"[A-Za-z0-9_./-]+")
"""Texts without a meaning of their own to Hydra or OmegaConf."""


class Assignment(NamedTuple):
    """One value of an override."""

    line: str
    """As on the command line."""
    key: str
    value: Any
    is_plain: bool
    """Whether it may be filled in: a sweep over plain values of a key that is no group."""


def expand(overrides: Sequence[Override]) -> list[tuple[Assignment, ...]]:
    """The assignments of each job of a command line; the last override varies fastest, as with Hydra."""
    # Of several lines with the same key the last one counts, in the place of the first.
    return list(product(*{each.get_key_element(): _assignments(each, overrides) for each in overrides}.values()))


def _assignments(override: Override, others: Sequence[Override]) -> list[Assignment]:
    key = override.get_key_element()
    if not override.is_sweep_override():
        return [Assignment(f"{key}={override.get_value_element_as_str()}", key, override.value(), False)]
    elements = list(override.sweep_iterator())
    values = [each.text if isinstance(each, QuotedString) else each for each in elements]
    is_plain = _is_plain_key(override, others) and all(map(_is_plain_value, values))
    lines = [f"{key}={Transformer.str(each)}" for each in elements]
    return [Assignment(line, key, value, is_plain) for line, value in zip(lines, values, strict=True)]


def _is_plain_key(override: Override, others: Sequence[Override]) -> bool:
    """Whether an override changes a key that is no group and that no other override touches."""
    key = override.key_or_group
    if override.type is not OverrideType.CHANGE or override.package or override.is_hydra_override() or _is_group(key):
        return False
    rest = {each.key_or_group for each in others if each is not override and not _chooses(each)}
    return not any(f"{each}.".startswith(f"{key}.") or f"{key}.".startswith(f"{each}.") for each in rest)


def _chooses(override: Override) -> bool:
    """Whether an override selects a file of a group, which Hydra does before it sets values."""
    return _is_group(override.key_or_group) and not isinstance(override.value(), dict)


def _is_group(key: str) -> bool:
    return any((each / key).is_dir() for each in folders())


def _is_plain_value(value: Any) -> bool:
    return bool(PLAIN.fullmatch(value)) if isinstance(value, str) else value is None or isinstance(value, (int, float))


class Checker:
    """Composes and validates one job of a sweep after the other."""

    def __init__(self) -> None:
        """Begin with nothing composed."""
        self._composition = lru_cache(maxsize=64)(lambda lines: Composition(compose(lines)))

    def check(self, job: Sequence[Assignment]) -> Config:
        """The configuration of a job.

        Raises:
            ConfigError: see `affmap.config.compose.check`.
        """
        try:
            composition = self._composition(tuple(each.line for each in job if not each.is_plain))
            return composition.check([each for each in job if each.is_plain])
        except (ConfigError, LookupError):
            return check([each.line for each in job])


class Composition:
    """A composed configuration that plain values can be filled into.

    Where other values follow from a value, as `map_layout: ${world}` does, all are resolved anew, once for each value.
    """

    def __init__(self, tree: Any, changes: Sequence[Assignment] = ()) -> None:
        """Take a configuration composed by Hydra, and make `changes`."""
        self._tree, self._changes = tree, tuple(changes)
        with _substitute(tree, self._changes):
            self._values, self._launch = values(tree), launch_settings(tree)
            check_launch(self._launch)
        self._is_free = cache(self._test_free)
        self._with = lru_cache(maxsize=1024)(lambda more: Composition(tree, (*self._changes, *more)))
        self._validated: dict[str, Any] = {}  # values of the last configuration that are still those of this one

    def check(self, changes: Sequence[Assignment]) -> Config:
        """The configuration in which further changes are made.

        Raises:
            ConfigError: a value is not allowed.
            LookupError: there is no such key.
        """
        new = _fill(self._values, changes)
        if dependencies := tuple(each for each in changes if not self._is_free(each.key)):
            return self._with(dependencies).check([each for each in changes if each not in dependencies])
        groups = {each.key.partition(".")[0] for each in changes}
        if "acts" in groups:  # it was written into the layouts
            self._validated = {}
        validated = {key: value for key, value in self._validated.items() if key not in groups}
        config = Config.checked({**new, **validated}, "the configuration")
        memory.check(config)
        self._validated = {key: getattr(config, key) for key in new if key not in groups}
        return config

    def _test_free(self, key: str) -> bool:
        """Whether no other value follows from that of a key."""
        other = Assignment("", key, "another_value", is_plain=True)
        with _substitute(self._tree, (*self._changes, other)):
            try:
                same_launch = launch_settings(self._tree) == self._launch
                return same_launch and values(self._tree) == _fill(self._values, [other])
            except ConfigError:  # something follows from it that has no such value
                return False


def _fill(configuration: dict[str, Any], changes: Sequence[Assignment]) -> dict[str, Any]:
    """Copy a configuration with changes; unchanged parts are shared.

    Raises:
        LookupError: a key does not exist, or holds several values.
    """
    new = dict(configuration)
    for change in changes:
        *groups, name = change.key.split(".")
        inner = new
        for group in groups:
            if not isinstance(inner[group], dict):
                raise LookupError(change.key)
            inner[group] = dict(inner[group])
            inner = inner[group]
        if isinstance(inner[name], (dict, list)):
            raise LookupError(change.key)
        inner[name] = change.value
    return new


@contextmanager
def _substitute(tree: Any, changes: Sequence[Assignment]) -> Iterator[None]:
    """Make changes to a composed configuration for the duration of the block."""
    before = {change.key: _unresolved(tree, change.key) for change in changes}
    try:
        for change in changes:
            OmegaConf.update(tree, change.key, change.value)
        yield
    finally:
        for key, value in before.items():
            OmegaConf.update(tree, key, value)


def _unresolved(tree: Any, key: str) -> Any:
    group, _, name = key.rpartition(".")
    values: Any = OmegaConf.to_container(OmegaConf.select(tree, group) if group else tree)
    return values[name]
