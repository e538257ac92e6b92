"""From Hydra's sweep grammar to a search space.

A **point** of the space is hyperopt's: a number for each searched key, an index where a key has options. The **values**
of a point are the application's. Knows nothing of hyperopt.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import (
    ChoiceSweep,
    Glob,
    IntervalSweep,
    Override,
    ParsedElementType,
    Quote,
    QuotedString,
    RangeSweep,
    Sweep,
    Transformer,
)
from hydra.errors import CompactHydraException, HydraException

Point = Mapping[str, float]
"""A number for each searched key."""


class SearchError(CompactHydraException):
    """An invalid search; the message, which Hydra shows without a traceback, gives the reason and a remedy."""


class TrialError(SearchError):
    """Trials that failed for other reasons than their values, more than allowed; nothing of their batch is kept."""


@dataclass(frozen=True)
class Interval:
    """Numbers from `low` to `high`, both included; on a logarithmic scale if `log`, integers if `integer`."""

    low: float
    high: float
    log: bool
    integer: bool

    def value(self, number: float) -> float:
        """The application's value; rounded if integer, clipped against rounding errors of logarithms."""
        return min(max(round(number) if self.integer else float(number), self.low), self.high)

    def text(self, number: float) -> str:
        """The value as Hydra reads it."""
        return str(self.value(number))

    def number(self, value: Any) -> float | None:
        """The inverse of `value`; None outside the interval."""
        inside = _is_number(value) and self.low <= value <= self.high and (not self.integer or value == round(value))
        return float(value) if inside else None

    def __str__(self) -> str:
        text = f"interval({self.low},{self.high})"
        text = f"int({text})" if self.integer else text
        return f"tag(log,{text})" if self.log else text


@dataclass(frozen=True)
class Options:
    """A list of values; neighbours are alike if `ordered`."""

    values: tuple[Any, ...]
    texts: tuple[str, ...]
    """The values as Hydra reads them."""
    ordered: bool

    def value(self, number: float) -> Any:
        """The application's value."""
        return self.values[self._index(number)]

    def text(self, number: float) -> str:
        """The value as Hydra reads it."""
        return self.texts[self._index(number)]

    def number(self, value: Any) -> float | None:
        """The inverse of `value`; None for other values."""
        return next((index for index, option in enumerate(self.values) if _equal(option, value)), None)

    def _index(self, number: float) -> int:
        return min(max(round(number), 0), len(self.values) - 1)

    def __str__(self) -> str:
        return f"{'range' if self.ordered else 'choice'}({','.join(self.texts)})"


Dimension = Interval | Options


@dataclass(frozen=True)
class Space:
    """The searched keys of a command line, and its fixed overrides."""

    dimensions: dict[str, Dimension] = field(default_factory=dict)
    """Key, without a leading +, -> its dimension."""
    keys: dict[str, str] = field(default_factory=dict)
    """Key -> key as on the command line, with its leading +."""
    fixed: list[str] = field(default_factory=list)
    """Overrides of all trials."""

    def values(self, point: Point) -> dict[str, Any]:
        """Searched key -> the application's value."""
        return {key: dimension.value(point[key]) for key, dimension in self.dimensions.items()}

    def overrides(self, point: Point) -> list[str]:
        """The overrides of a trial's job."""
        texts = {key: dimension.text(point[key]) for key, dimension in self.dimensions.items()}
        return self.fixed + [f"{self.keys[key]}={text}" for key, text in texts.items()]

    def stacked(self, points: Sequence[Point]) -> list[str]:
        """The overrides of one job for several trials: a list of values for each searched key."""
        texts = {
            key: ",".join(dimension.text(point[key]) for point in points) for key, dimension in self.dimensions.items()
        }
        return self.fixed + [f"{self.keys[key]}=[{text}]" for key, text in texts.items()]

    def point(self, values: Mapping[str, Any], origin: str) -> Point:
        """The inverse of `values`; `origin` names their source in an error.

        Raises:
            SearchError: a key is missing or not searched, or a value lies outside the space.
        """
        if values.keys() != self.dimensions.keys():
            raise SearchError(
                f"{origin} has values of {_join(values)}, but the searched keys are {_join(self.dimensions)}; "
                "give a value of each of these, and of no other."
            )
        point = {}
        for key, dimension in self.dimensions.items():
            number = dimension.number(values[key])
            if number is None:
                raise SearchError(
                    f"{origin}: {key} = {values[key]!r} does not lie in {dimension}; change one of the two."
                )
            point[key] = number
        return point


def parse(parser: OverridesParser, params: Mapping[str, str], arguments: Sequence[str]) -> Space:
    """The space of a configuration file's `params` and a command line's `arguments`, which win.

    Raises:
        SearchError: a space cannot be searched; the message names its key.
        OverrideParseException: an override is malformed.
    """
    overrides = parser.parse_overrides([*(f"{key}={text}" for key, text in params.items()), *arguments])
    space = Space()
    for name, override in {_name(override): override for override in overrides}.items():
        if override.is_sweep_override():
            space.dimensions[name] = _dimension(name, override, parser)
            space.keys[name] = override.get_key_element()
        else:
            space.fixed.append(str(override.input_line))
    if not space.dimensions:
        raise SearchError(
            "There is nothing to search over; give at least one key a space, such as 'lr=interval(0.1,0.9)', on the "
            "command line or in hydra.sweeper.params."
        )
    return space


def _name(override: Override) -> str:
    return override.key_or_group + (f"@{override.package}" if override.package else "")


def _dimension(name: str, override: Override, parser: OverridesParser) -> Dimension:
    sweep: Any = override.value()
    allowed = {"log"} if isinstance(sweep, IntervalSweep) else set()
    if isinstance(sweep, Sweep) and (unknown := sweep.tags - allowed):
        raise SearchError(
            f"{override.input_line}: the tag {_join(unknown)} means nothing here; the only one is log, of intervals, "
            f"as in '{name}=tag(log,interval(1e-4,1e-1))'."
        )
    if isinstance(sweep, IntervalSweep):
        return _interval(name, override, sweep)
    options = _options(override, sweep, parser)
    if not options.values:
        raise SearchError(f"{override.input_line}: there is no value that {name} could have; correct it.")
    return options


def _interval(name: str, override: Override, sweep: IntervalSweep) -> Interval:
    low, high, log = sweep.start, sweep.end, "log" in sweep.tags
    assert low is not None and high is not None
    if not (math.isfinite(low) and math.isfinite(high)):
        raise SearchError(f"{override.input_line}: both ends of the interval must be finite numbers.")
    if not low < high:
        raise SearchError(
            f"{override.input_line}: the interval is empty, because {low} is not less than {high}; "
            f"exchange its ends, or give {name} a fixed value."
        )
    if log and low <= 0:
        raise SearchError(
            f"{override.input_line}: a logarithmic interval cannot begin at {low}; begin it above 0, or omit the tag."
        )
    return Interval(low, high, log, integer=isinstance(low, int) and isinstance(high, int))


def _options(override: Override, sweep: Any, parser: OverridesParser) -> Options:
    if isinstance(sweep, RangeSweep):
        numbers = tuple(sweep.range())
        return Options(numbers, tuple(map(Transformer.str, numbers)), ordered=True)
    if isinstance(sweep, ChoiceSweep):
        # In their own order, also where Hydra is to shuffle.
        texts = tuple(_text(option, parser) for option in sweep.list)
        return Options(tuple(_read(text, parser) for text in texts), texts, ordered=False)
    assert isinstance(sweep, Glob)
    names = tuple(override.sweep_string_iterator())
    return Options(names, names, ordered=False)


def _text(option: ParsedElementType, parser: OverridesParser) -> str:
    """An option as Hydra reads it; a text gets quotes where Hydra would misread it."""
    text = Transformer.str(option)
    if isinstance(option, str):
        try:
            same = _read(text, parser) == option
        except HydraException:
            same = False
        return text if same else QuotedString(option, Quote.single).with_quotes()
    return text


def _read(text: str, parser: OverridesParser) -> Any:
    return parser.parse_override(f"key={text}").value()


def _equal(one: Any, other: Any) -> bool:
    if _is_number(one) and _is_number(other):
        return math.isclose(one, other)  # steps of a range have rounding errors
    return bool(type(one) is type(other) and one == other)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _join(keys: Iterable[str]) -> str:
    return ", ".join(sorted(keys)) or "nothing"
