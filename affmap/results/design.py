"""The design of a sweep: its settings, and the two factors that a report tells apart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
)
from affmap.settings.messages import ConfigError


@dataclass(frozen=True)
class Design:
    """Completed settings, and the two keys that a report tells apart."""

    settings: tuple[Setting, ...]
    growth: Setting | None = None
    """A longer training whose maps were kept after several epochs, where the experiment has one."""
    x_key: str | None = None
    """The key on the x axis; None for the context size or, where that is not varied, the first number that is."""
    color_key: str | None = None
    """The key that colours tell apart; None for whatever else is varied."""
    baselines: tuple[Setting, ...] = ()
    """Flights of agents without a learned model in the same worlds, where the experiment has them."""

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
            ConfigError: they differ in another one, and some would end in the same box; or both keys are one.
        """
        chosen, first = (self.x.key, self.color.key), self.settings[0]
        if self.x == self.color:
            raise ConfigError(f"report.x and report.color are both {self.x.key!r}; name two keys.")
        others = [key for key in self._varied if key not in chosen]
        if not others:
            return
        constant = [key for key in chosen if key not in self._varied]
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
        kept: list[str] = []
        for key in sorted(keys, key=lambda key: key not in FACTORS):  # `world` follows from the layout flown in
            if not self._determining(key, kept):
                kept.append(key)
        return [key for key in keys if key in kept]

    def _determining(self, key: str, others: Sequence[str]) -> str | None:
        """The first of some keys that a key follows from: with one of its values goes one value of that key."""
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
        if key := self._chosen(self.x_key, "report.x"):
            return make_factor(key)
        color = self._chosen(self.color_key, "report.color")
        varied = [key for key in self._varied if key != color]
        numbers = [key for key in varied if all(not isinstance(value, str) for value in self._values(key))]
        if CONTEXT_SIZE.key in numbers:
            return CONTEXT_SIZE
        names = [] if len(self._varied) < 2 else varied[-1:]
        return make_factor(next(iter([*numbers, *names]), CONTEXT_SIZE.key))

    @cached_property
    def color(self) -> Factor:
        """The factor that colours tell apart; the planner, or the layout, where no other key is varied."""
        if key := self._chosen(self.color_key, "report.color"):
            return make_factor(key)
        others = [key for key in self._varied if key != self.x.key]
        return make_factor(next(iter(others), LAYOUT.key if self.x == PLANNER else PLANNER.key))

    def _chosen(self, key: str | None, name: str) -> str | None:
        """A key that the settings of a report name, or the varied key that it says the same as."""
        if key is None:
            return None
        if key not in self.settings[0].values:
            known = self._varied or list(self.settings[0].values)
            raise ConfigError(f"{name} = {key!r} is not a key that varies here; these are: {', '.join(known)}.")
        if key in self._varied or len(self._values(key)) == 1:
            return key
        return self._determining(key, self._varied) or key

    @cached_property
    def factors(self) -> list[Factor]:
        """Both factors, and those that every table of runs has a column for."""
        return list(dict.fromkeys([LAYOUT, PLANNER, CONTEXT_SIZE, self.color, self.x]))

    @cached_property
    def x_values(self) -> list[Value]:
        """The values on the x axis: numbers ascending, names in the order of the settings."""
        values = self._values(self.x.key)
        return values if any(isinstance(value, str) for value in values) else sorted(values)

    @cached_property
    def color_values(self) -> list[Value]:
        """The values that colours tell apart: planners in the order of `PLANNERS`, others in that of the settings."""
        return list(self.planners) if self.color == PLANNER else self._values(self.color.key)

    @property
    def context_sizes(self) -> list[int]:
        """All context sizes, ascending."""
        return sorted({setting.context_size for setting in self.settings})

    @property
    def planners(self) -> list[str]:
        """The planners that were run, in the order of `PLANNERS`, others after them in that of their names."""
        kinds = {setting.planner for setting in self.settings}
        return sorted(kinds, key=lambda kind: ([*PLANNERS, kind].index(kind), kind))

    @property
    def layouts(self) -> list[str]:
        """The layouts that were flown in, in the order of the settings."""
        return list(dict.fromkeys(setting.layout for setting in self.settings))

    def where(self, values: Mapping[str, Value]) -> list[Setting]:
        """The settings that have some values: key -> value."""
        return [setting for setting in self.settings if values.items() <= setting.values.items()]

    def setting(self, context_size: int, planner: str | None = None, layout: str | None = None) -> Setting | None:
        """The first setting of a context size (and a planner, and a layout), or None where it was not run."""
        values = {CONTEXT_SIZE.key: context_size, PLANNER.key: planner, LAYOUT.key: layout}
        return next(iter(self.where({key: value for key, value in values.items() if value is not None})), None)
