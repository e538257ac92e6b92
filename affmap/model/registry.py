"""Registry of the transition models that a configuration can name: those of this folder and those of others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from pydantic import PlainValidator

from affmap.settings import Count, Neutral, NonNegative, Settings, names, preset
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
    """Settings of a kind of transition model, a file of `conf/model/transition`.

    One that needs other codes than the paper's derives its class from `CodeSettings`.
    """

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


Encoder = Literal["plain", "centered", "channels"]
"""Kind of codes of a view, see `affmap.model.vision`."""


def unit_ends(context_size: int, num_channels: int) -> list[int]:
    """Ends of the units of each of K channels in codes by `channels`: C / K units for each, rounded."""
    return [channel * context_size // num_channels for channel in range(1, num_channels + 1)]


class CodeSettings(Settings):
    """Codes that a transition model asks for: their encoder, and terms of the training loss that shape them.

    Without a code (C = 0) none of them does anything, so that any model can be swept over context sizes.
    """

    encoder: Annotated[Encoder, Neutral("plain")] = preset()
    """Codes of views: plain, as in the paper; centered, less the code of the empty view; or channels, each channel
    encoded by itself into units of its own (a single one as in centered)."""
    paste: Annotated[NonNegative, Neutral(0.0)] = preset()
    """Weight of the condition that the code of two views laid over each other is the sum of their codes. Only views
    that fill different channels are laid over each other, so it does nothing where all worlds fill the same one."""
    effect_std: Annotated[NonNegative, Neutral(0.0)] = preset()
    """Standard deviation of a Gaussian prior on the effect of a code on the mean, u/step; 0 for no prior."""
    penalty: Annotated[NonNegative, Neutral(0.0)] = preset()
    """Weight of a penalty for large and for dependent units of the codes: L1 and total correlation."""

    @property
    def has_terms(self) -> bool:
        """Whether the training loss has terms besides the likelihood."""
        return bool(self.paste or self.effect_std or self.penalty)

    @property
    def in_blocks(self) -> bool:
        """Whether the code consists of blocks with effects of their own, as in `affmap.model.effects.Effects`."""
        return False


@register_transition
class MLPSettings(CodeSettings, defaults="model/transition/mlp"):
    """The paper's multilayer perceptron, which has no hidden state (`conf/model/transition/mlp.yaml`)."""

    kind: Literal["mlp"] = preset()

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights, see `TransitionSettings.make`."""
        from affmap.model.transition import MLP

        return MLP(generators, context_size, hidden_size, delta_scale)


@register_transition
class GRUSettings(CodeSettings, defaults="model/transition/gru"):
    """A gated recurrent unit (`conf/model/transition/gru.yaml`)."""

    kind: Literal["gru"] = preset()

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights, see `TransitionSettings.make`."""
        from affmap.model.gru import GRU

        return GRU(generators, context_size, hidden_size, delta_scale)


@register_transition
class GateL0RDSettings(CodeSettings, defaults="model/transition/gatel0rd"):
    """A recurrent cell whose gates are mostly shut (`conf/model/transition/gatel0rd.yaml`)."""

    kind: Literal["gatel0rd"] = preset()
    gate_penalty: NonNegative = preset()
    """Weight of the share of open gates in the training loss (lambda), nats."""
    gate_noise: NonNegative = preset()
    """Standard deviation of the noise on the inputs of gates in training."""

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights, see `TransitionSettings.make`."""
        from affmap.model.gatel0rd import GateL0RD

        return GateL0RD(generators, context_size, hidden_size, delta_scale, self.gate_penalty, self.gate_noise)


@register_transition
class EffectsSettings(CodeSettings):
    """Free motion and effects of blocks of the code (`conf/model/transition/additive.yaml`, `split.yaml`)."""

    kind: Literal["additive", "split"]
    """Whether all effects start from free motion, or blocks act in turn on the motion that others changed."""
    block_size: Count
    """Units of the code in a block; the last one may have fewer. With codes of channels, none has units of two."""

    @property
    def in_blocks(self) -> bool:
        """Whether the code consists of blocks with effects of their own: it does."""
        return True

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights, see `TransitionSettings.make`; a quarter of the hidden units for each part."""
        from affmap.model.effects import Effects

        units = max(1, hidden_size // 4)
        return Effects(generators, context_size, delta_scale, units, self.block_size, in_turn=self.kind == "split")


@register_transition
class HyperSettings(CodeSettings, defaults="model/transition/hyper"):
    """A perceptron whose weights are linear in the code (`conf/model/transition/hyper.yaml`)."""

    kind: Literal["hyper"] = preset()
    rank: Count = preset()
    """Rank of the change of each layer."""

    def make(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> TransitionModel:
        """Draw the initial weights, see `TransitionSettings.make`; half of the hidden units."""
        from affmap.model.hyper import Hyper

        return Hyper(generators, context_size, delta_scale, max(1, hidden_size // 2), self.rank)


def _choose(values: Any) -> Any:
    if isinstance(values, str):
        example = values if values in names("model/transition") else "gru"
        raise ValueError(
            f"should be the keys of a file of conf/model/transition; choose one by model/transition={example}"
        )
    return _registry.choose(values)


AnyTransition = Annotated[TransitionSettings, PlainValidator(_choose)]
"""Settings from a file of `conf/model/transition`, distinguished by `kind`."""

MLP_SETTINGS = MLPSettings(kind="mlp")
"""Default transition model, also of all configurations that predate the others."""
