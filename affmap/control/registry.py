"""Registry of the agents that a configuration can name: those of this folder and those registered by others."""

from __future__ import annotations

from typing import Annotated, Literal, Protocol

from pydantic import PlainValidator

from affmap.control.controller import Controller
from affmap.settings import Length, Settings, preset
from affmap.settings.registry import Registry, S

_registry = Registry("affmap.control", place="agent.kind")


def register_agent(agent: type[S]) -> type[S]:
    """Make an agent known to configurations, by the value of its field `kind`; a class decorator.

    It is a `Settings` class: its fields are the keys of its file in `conf/agent`. It has the methods of `Controller`.
    See `affmap.settings.extensions` for classes of your own packages and modules.

    Raises:
        ValueError: it has no field `kind`, or another class has this kind, or a method is missing.
    """
    return _registry.register(agent)


class ConfiguredController(Controller, Protocol):
    """A controller whose settings are a file of `conf/agent`."""

    @property
    def kind(self) -> str:
        """Its name in configurations and tables."""


@register_agent
class AgentSettings(Settings, defaults="agent/planner"):
    """A model-predictive `Agent` (`conf/agent/planner.yaml`), made of the groups `model`, `lookup` and `planner`."""

    kind: Literal["planner"] = preset()


@register_agent
class OracleSettings(Settings, defaults="agent/oracle"):
    """A model-predictive agent that knows the true physics, of groups as `AgentSettings` (`conf/agent/oracle.yaml`)."""

    kind: Literal["oracle", "seen", "filter", "true_mean", "true_deviation"] = preset()
    """Part of the imagination that is true: all; all that views show; all, and the agent keeps track of its place in
    fog; or the mean or the deviation, the other being the model's."""
    std: Length = preset()
    """Standard deviation of a true step outside fog, u."""


def is_learned(agent: AgentSettings | OracleSettings | ConfiguredController) -> bool:
    """Whether an agent imagines with a trained model, wholly or in part."""
    return isinstance(agent, AgentSettings) or (isinstance(agent, OracleSettings) and agent.kind.startswith("true"))


AnyAgent = Annotated[AgentSettings | OracleSettings | ConfiguredController, PlainValidator(_registry.choose)]
"""Settings from a file of `conf/agent`, distinguished by `kind`."""

PLANNER = AgentSettings(kind="planner")
"""Default agent, also of all configurations that predate the others."""
