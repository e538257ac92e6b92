"""The planners that a configuration can name: those of this folder, and others that are registered."""

from __future__ import annotations

from typing import Annotated, Protocol

from pydantic import PlainValidator

from affmap.planning.planner import Planner
from affmap.settings.registry import Registry, S

_registry = Registry("affmap.planning", ("initial", "plan"), place="planner.kind")


def register_planner(planner: type[S]) -> type[S]:
    """Make a planner known to configurations, by the value of its field `kind`; a class decorator.

    It is a `Settings` class: its fields are the keys of its file in `conf/planner`. It has the methods of `Planner`.
    See `affmap.settings.extensions` for classes of your own packages and modules.

    Raises:
        ValueError: it has no field `kind`, or another class has this kind, or a method is missing.
    """
    return _registry.register(planner)


class ConfiguredPlanner(Planner, Protocol):
    """A planner whose settings are a file of `conf/planner`."""

    @property
    def kind(self) -> str:
        """Its name in configurations and tables."""


AnyPlanner = Annotated[ConfiguredPlanner, PlainValidator(_registry.choose)]
"""A file of `conf/planner`, by its `kind`."""
