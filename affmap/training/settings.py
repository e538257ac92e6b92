"""The numbers of a training, apart from the code that needs Lightning (which takes seconds to import)."""

from typing import Literal

from pydantic import Field, PositiveFloat, PositiveInt

from affmap.settings import Settings


class TrainingSettings(Settings):
    """How models are trained (`conf/training`)."""

    num_epochs: PositiveInt
    batch_size: PositiveInt
    """Sequences a batch."""
    chunk_length: PositiveInt
    """Steps between updates: errors are propagated back through at most so many."""
    vision_lr: PositiveFloat
    """Learning rate of the vision model."""
    transition_lr: PositiveFloat
    """Learning rate of the transition model."""
    vision_max_norm: PositiveFloat
    """Clipping norm of the vision model's gradient, per member."""
    transition_max_norm: PositiveFloat
    """Clipping norm of the transition model's gradient, per member."""
    adam_eps: PositiveFloat
    """Adam's epsilon."""
    snapshot_epochs: tuple[PositiveInt, ...]
    """Epochs after which the weights are kept; the last epoch always is."""
    accelerator: Literal["cpu", "gpu", "auto"] = Field(exclude=True)
    """Where to train."""
