"""Settings of models and look-ups, in a module without torch, which takes seconds to import."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from affmap.model.registry import MLP_SETTINGS, AnyTransition, CodeSettings
from affmap.settings import Count, CountOrNone, Length, Neutral, NonNegative, Positive, Settings, preset
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


class NoMemory(Settings, defaults="memory/none"):
    """Codes are looked up in views of the world, as in the paper (`conf/memory/none.yaml`)."""

    kind: Literal["none"] = preset()


class MemorySettings(Settings, defaults="memory/explored"):
    """Settings of a memorised map, which replaces the views in planning (`conf/memory`)."""

    kind: Literal["network"] = preset()
    explored: Literal["here", "training", "nothing"] = preset()
    """World that it has explored as long as the data set before: that in which it flies, that of the data, or none."""
    learns: bool = preset()
    """Whether it learns in flight from each view that is sensed; otherwise it stays as it was explored."""
    early_steps: CountOrNone = preset()
    """Steps of another flight in the same world before each run, with another start and goal."""
    unit_spacing: Annotated[Length, Field(ge=0.05)] = preset()
    """Distance between neighbouring units of the network, u."""
    unit_width: Length = preset()
    """Standard deviation of a unit's bell-shaped activation, u."""
    ridge: Positive = preset()
    """Penalty on the weights in exploration, as a share of the mean square error."""
    noise: Positive = preset()
    """Variance of a code seen in flight, where weights have a variance of 1 when flights begin."""

    @property
    def name(self) -> str:
        """Short description that distinguishes it from others."""
        learning = f", learning, {self.early_steps} steps before" if self.learns else ""
        return f"{self.explored} from memory{learning}"


AnyMemory = Annotated[NoMemory | MemorySettings, Field(discriminator="kind")]
"""Settings from a file of `conf/memory`, distinguished by `kind`."""

NO_MEMORY = NoMemory(kind="none")
"""Default, also of all configurations that predate the others."""
