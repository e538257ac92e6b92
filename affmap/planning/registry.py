"""The planners that a configuration can name: those of this folder, and whatever else is registered."""

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated, Any, Protocol, TypeVar, Union

from pydantic import Field, PlainValidator, TypeAdapter

import affmap.planning
from affmap.planning.planner import Planner
from affmap.settings import Settings

P = TypeVar("P", bound=Settings)

_registered: list[type[Settings]] = []


class ConfiguredPlanner(Planner, Protocol):
    """A planner whose settings are a file of `conf/planner`."""

    kind: str
    """Its name in configurations and tables."""


def register(planner: type[P]) -> type[P]:
    """Make a planner known to configurations, by the value of its field `kind`; to be put above its class.

    Every module of this folder is loaded before a configuration is checked; a planner elsewhere is known once its
    module has been imported.

    Raises:
        ValueError: it has no field `kind`, or another planner has this kind.
    """
    if "kind" not in planner.model_fields:
        raise ValueError(f"{planner.__name__} has no field kind; give it one, such as kind: Literal['mine'].")
    known = [each for each in _registered if each.__qualname__ != planner.__qualname__]  # a notebook defines it anew
    if clash := [each.__name__ for each in known if _kinds(each) & _kinds(planner)]:
        raise ValueError(f"{planner.__name__} has the kind of {clash[0]}; give it one of its own.")
    _registered[:] = [*known, planner]
    return planner


def _kinds(planner: type[Settings]) -> set[str]:
    return {*planner.model_fields["kind"].annotation.__args__}  # type: ignore[union-attr]


def _planner(values: Any) -> Any:
    """The planner of plain values, by their `kind`."""
    for module in iter_modules(affmap.planning.__path__):
        import_module(f"{affmap.planning.__name__}.{module.name}")
    return _adapter(*sorted(_registered, key=lambda planner: sorted(_kinds(planner)))).validate_python(values)


@cache
def _adapter(*planners: type[Settings]) -> TypeAdapter[Any]:
    union: Any = Union[planners]  # noqa: UP007
    chosen: Any = Annotated[union, Field(discriminator="kind")] if len(planners) > 1 else union
    return TypeAdapter(chosen)


AnyPlanner = Annotated[ConfiguredPlanner, PlainValidator(_planner)]
"""A file of `conf/planner`; its `kind` tells which."""
