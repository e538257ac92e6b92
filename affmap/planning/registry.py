"""The planners that a configuration can name: those of this folder, and others that are registered."""

from typing import Annotated, Protocol

from pydantic import PlainValidator

from affmap.planning.planner import Planner
from affmap.settings.registry import Registry

_registry = Registry("affmap.planning", ("initial", "plan"))

register = _registry.register


class ConfiguredPlanner(Planner, Protocol):
    """A planner whose settings are a file of `conf/planner`."""

    kind: str
    """Its name in configurations and tables."""


AnyPlanner = Annotated[ConfiguredPlanner, PlainValidator(_registry.choose)]
"""A file of `conf/planner`, by its `kind`."""
