"""Settings of models and look-ups, in a module without torch, which takes seconds to import."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from affmap.model.registry import MLP_SETTINGS, AnyTransition, CodeSettings
from affmap.settings import Count, CountOrNone, Neutral, NonNegative, Positive, Settings, preset
from affmap.view import EXTENT


class ModelSettings(Settings, defaults="model/default"):
    """Settings of the architecture (`conf/model`)."""

    context_size: CountOrNone = preset()
    """C, length of the context code; 0 is a transition model without vision."""
    hidden_size: Count = preset()
    """Hidden units of the transition model."""
    delta_scale: Positive = preset()
    """Factor on the change of position, for inputs and predictions."""
    transition: Annotated[AnyTransition, Neutral(MLP_SETTINGS)] = preset()
    """The kind of transition model, a file of `conf/model/transition`."""

    @property
    def code(self) -> CodeSettings:
        """The codes that the transition model asks for; those of the paper, unless its settings say otherwise."""
        return self.transition if isinstance(self.transition, CodeSettings) else MLP_SETTINGS

    @property
    def name(self) -> str:
        """Short description that distinguishes it from others."""
        kind = "" if self.transition == MLP_SETTINGS else f"{self.transition_name}, "
        return f"{kind}context size {self.context_size}"

    @property
    def transition_name(self) -> str:
        """Kind of the transition model, and that of its codes where they are not the paper's."""
        encoder = self.code.encoder
        return self.transition.kind + (f" ({encoder})" if encoder != "plain" else "")


class LookupSettings(Settings, defaults="lookup/map"):
    """Settings of the look-up of context codes in planning (`conf/lookup`)."""

    spacing: Annotated[NonNegative, Field(le=EXTENT)] = preset()
    """Largest distance between neighbouring nodes of the affordance map, u, at most the width of a view (between nodes
    further apart lie places that none of them shows); 0: no map, codes from the view at every position, as in the
    paper."""
    differentiable: bool = preset()
    """Whether gradients flow through the map to the position; the paper's do not."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.differentiable and self.spacing == 0:
            raise ValueError("differentiable = True needs an affordance map: lookup.spacing must be greater than 0.")
        return self

    @property
    def name(self) -> str:
        """Short description that distinguishes it from others."""
        return f"map of {self.spacing:g} u" if self.spacing else "exact look-ups"
