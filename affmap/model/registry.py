"""Registry of the transition models that a configuration can name: those of this folder and those of others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from pydantic import PlainValidator

from affmap.settings import Settings, preset
from affmap.settings.registry import Registry, S

if TYPE_CHECKING:  # torch takes seconds to import
    from affmap.model.layers import Generators
    from affmap.model.transition import TransitionModel

_registry = Registry("affmap.model", ("make",), place="transition.kind")


def register_transition(settings: type[S]) -> type[S]:
    """Make a transition model known to configurations, by the value of its field `kind`; a class decorator.

    It is a `Settings` class: its fields are the keys of its file in `conf/model/transition`. Its method `make`, see
    `TransitionSettings`, draws the models.
    See `affmap.settings.extensions` for classes of your own packages and modules.

    Raises:
        ValueError: it has no field `kind`, or another class has this kind, or a method is missing.
    """
    return _registry.register(settings)


class TransitionSettings(Protocol):
    """Settings of a kind of transition model, a file of `conf/model/transition`."""

    @property
    def kind(self) -> str:
        """Its name in configurations and tables."""

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights of M models.

        Args:
            generators: M of them; member m's weights come from the m-th, and from nothing else.
            context_size: see `affmap.model.settings.ModelSettings`, as the next two.
            hidden_size: hidden units.
            delta_scale: factor on the change of position.
        """
        ...


@register_transition
class MLPSettings(Settings, defaults="model/transition/mlp"):
    """The paper's multilayer perceptron, which has no hidden state (`conf/model/transition/mlp.yaml`)."""

    kind: Literal["mlp"] = preset()

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights, see `TransitionSettings.make`."""
        from affmap.model.transition import MLP

        return MLP(generators, context_size, hidden_size, delta_scale)


@register_transition
class GRUSettings(Settings, defaults="model/transition/gru"):
    """A gated recurrent unit (`conf/model/transition/gru.yaml`)."""

    kind: Literal["gru"] = preset()

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights, see `TransitionSettings.make`."""
        from affmap.model.gru import GRU

        return GRU(generators, context_size, hidden_size, delta_scale)


def _choose(values: Any) -> Any:
    if isinstance(values, str):
        raise ValueError("should be the keys of a file of conf/model/transition; choose one by model/transition=gru")
    return _registry.choose(values)


AnyTransition = Annotated[TransitionSettings, PlainValidator(_choose)]
"""Settings from a file of `conf/model/transition`, distinguished by `kind`."""

MLP_SETTINGS = MLPSettings(kind="mlp")
"""Default transition model, also of all configurations that predate the others."""
