"""The design of a sweep: its settings, and the two factors of its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from affmap.results.setting import (
    CONTEXT_SIZE,
    FACTORS,
    LAYOUT,
    PLANNER,
    PLANNERS,
    Factor,
    Setting,
    Value,
    make_factor,
    reader_name,
)
from affmap.settings.messages import ConfigError


@dataclass(frozen=True)
class Design:
    """Completed settings, and the two keys by which a report groups them."""

    settings: tuple[Setting, ...]
    growth: Setting | None = None
    """A longer training with maps after several epochs, where the experiment has one."""
    x_key: str | None = None
    """The key on the x axis; None for the context size or, where that is not varied, the first number that is."""
    color_key: str | None = None
    """The grouping variable shown by colour; None for whatever else is varied."""
    baselines: tuple[Setting, ...] = ()
    """Settings of agents without a learned model in the same layouts, where the experiment has them."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Planner, layout or model -> its name for readers, see `name`."""

    def __post_init__(self) -> None:
        if not self.settings:
            raise ConfigError("a report needs at least one completed setting.")
        values = [tuple(setting.values.items()) for setting in self.settings]
        if len(set(values)) < len(values):
            raise ConfigError(
                "a report tells settings apart by their values of the keys that are swept over, and here others "
                "differ, too; sweep over one key or two."
            )

    def check_factors(self) -> None:
        """Make sure that settings differ in the two keys of a report only.

        Raises:
            ConfigError: they differ in another key, so that some would share a box; or both keys are the same.
        """
        factors, first = (self.x.key, self.color.key), self.settings[0]
        if self.x == self.color:
            raise ConfigError(f"report.x and report.color are both {self.x.key!r}; name two keys.")
        others = [key for key in self._varied if key not in factors]
        if not others:
            return
        constant = [key for key in factors if key not in self._varied]
        if self.x_key and self.x.key in constant and len(self._varied) <= 2:
            raise ConfigError(
                f"report.x = {self.x_key!r} has one value here, {first.values[self.x.key]}; name a key that varies: "
                f"{', '.join(self._varied)}."
            )
        raise ConfigError(
            f"a report tells two keys apart, here {self.x.key} on the x axis and {self.color.key} by colour, and there "
            f"are several values of {' and '.join(others)}, too; give one, such as "
            f"{others[0]}={first.values[others[0]]}, with output=runs/<name>, or make a table of its values with "
            f"report.compare={others[0]}."
        )

    @cached_property
    def _varied(self) -> list[str]:
        """Keys whose values differ among the settings, without those that follow from another one of them."""
        keys = [key for key in self.settings[0].values if len(self._values(key)) > 1]
        independent: list[str] = []
        for key in sorted(keys, key=lambda key: key not in FACTORS):  # `world` follows from the control layout
            if not self._determining(key, independent):
                independent.append(key)
        return [key for key in keys if key in independent]

    def _determining(self, key: str, others: Sequence[str]) -> str | None:
        """The first of some other keys that determines a key: each of its values goes with a single value."""
        for other in others:
            pairs = {(setting.values[other], setting.values[key]) for setting in self.settings}
            if len(pairs) == len(self._values(other)):
                return other
        return None

    def _values(self, key: str) -> list[Value]:
        """The distinct values of a key, in the order of the settings."""
        return list(dict.fromkeys(setting.values[key] for setting in self.settings))

    @cached_property
    def x(self) -> Factor:
        """The factor on the x axis."""
        if key := self._resolve(self.x_key, "report.x"):
            return make_factor(key)
        color = self._resolve(self.color_key, "report.color")
        varied = [key for key in self._varied if key != color]
        numbers = [key for key in varied if all(not isinstance(value, str) for value in self._values(key))]
        if CONTEXT_SIZE.key in numbers:
            return CONTEXT_SIZE
        names = [] if len(self._varied) < 2 else varied[-1:]
        return make_factor(next(iter([*numbers, *names]), CONTEXT_SIZE.key))

    @cached_property
    def color(self) -> Factor:
        """The grouping variable shown by colour; the planner, or the layout, where no other key is varied."""
        if key := self._resolve(self.color_key, "report.color"):
            return make_factor(key)
        others = [key for key in self._varied if key != self.x.key]
        return make_factor(next(iter(others), LAYOUT.key if self.x == PLANNER else PLANNER.key))

    def _resolve(self, key: str | None, name: str) -> str | None:
        """A key named in the settings of a report, or the varied key that is equivalent to it."""
        if key is None:
            return None
        if key not in self.settings[0].values:
            options = self._varied or list(self.settings[0].values)
            raise ConfigError(f"{name} = {key!r} is not a key that varies here; these are: {', '.join(options)}.")
        if key in self._varied or len(self._values(key)) == 1:
            return key
        return self._determining(key, self._varied) or key

    @cached_property
    def factors(self) -> list[Factor]:
        """Both factors, and those with a column in every table of runs."""
        return list(dict.fromkeys([LAYOUT, PLANNER, CONTEXT_SIZE, self.color, self.x]))

    @cached_property
    def x_values(self) -> list[Value]:
        """The values on the x axis: numbers ascending, names in the order of the settings."""
        values = self._values(self.x.key)
        return values if any(isinstance(value, str) for value in values) else sorted(values)

    @cached_property
    def color_values(self) -> list[Value]:
        """The values shown by colour: planners in the order of `PLANNERS`, others in that of the settings."""
        return list(self.planners) if self.color == PLANNER else self._values(self.color.key)

    @property
    def context_sizes(self) -> list[int]:
        """All context sizes, ascending."""
        return sorted({setting.context_size for setting in self.settings})

    @property
    def planners(self) -> list[str]:
        """The planners, in the order of `PLANNERS`, then others by name."""
        kinds = {setting.planner for setting in self.settings}
        return sorted(kinds, key=lambda kind: ([*PLANNERS, kind].index(kind), kind))

    @property
    def layouts(self) -> list[str]:
        """The layouts of control, in the order of the settings."""
        return list(dict.fromkeys(setting.layout for setting in self.settings))

    def name(self, value: str) -> str:
        """The name of a planner, a layout or a model for readers."""
        return reader_name(value, self.names)

    def where(self, values: Mapping[str, Value]) -> list[Setting]:
        """The settings with some values: key -> value."""
        return [setting for setting in self.settings if values.items() <= setting.values.items()]

    def setting(self, context_size: int, planner: str | None = None, layout: str | None = None) -> Setting | None:
        """The first setting of a context size (and a planner, and a layout), or None if there is none."""
        values = {CONTEXT_SIZE.key: context_size, PLANNER.key: planner, LAYOUT.key: layout}
        return next(iter(self.where({key: value for key, value in values.items() if value is not None})), None)
