"""Registry of the agents that a configuration can name: those of this folder and those registered by others."""

from typing import Annotated, Literal, Protocol

from pydantic import PlainValidator

from affmap.control.controller import Controller
from affmap.settings import Length, Settings
from affmap.settings.registry import Registry

_registry = Registry("affmap.control")

register = _registry.register


class ConfiguredController(Controller, Protocol):
    """A controller whose settings are a file of `conf/agent`."""

    kind: str
    """Its name in configurations and tables."""


@register
class AgentSettings(Settings, defaults="agent/planner"):
    """A model-predictive `Agent` (`conf/agent/planner.yaml`), made of the groups `model`, `lookup` and `planner`."""

    kind: Literal["planner"]


@register
class OracleSettings(Settings, defaults="agent/oracle"):
    """A model-predictive agent that knows the true physics, of groups as `AgentSettings` (`conf/agent/oracle.yaml`)."""

    kind: Literal["oracle", "true_mean", "true_deviation"]
    """Part of the imagination that is true: all, the mean or the deviation; the rest comes from the model."""
    std: Length
    """Standard deviation of a true step outside fog, u."""


def is_learned(agent: "AgentSettings | OracleSettings | ConfiguredController") -> bool:
    """Whether an agent imagines with a trained model, wholly or in part."""
    return isinstance(agent, AgentSettings) or (isinstance(agent, OracleSettings) and agent.kind != "oracle")


AnyAgent = Annotated[AgentSettings | OracleSettings | ConfiguredController, PlainValidator(_registry.choose)]
"""Settings from a file of `conf/agent`, distinguished by `kind`."""

PLANNER = AgentSettings(kind="planner")
"""Default agent, also of all configurations that predate the others."""
