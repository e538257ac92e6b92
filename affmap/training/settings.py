"""The numbers of a training, apart from the code that needs Lightning (which takes seconds to import)."""

from typing import Literal

from pydantic import Field

from affmap.settings import Count, Positive, Settings


class TrainingSettings(Settings):
    """How models are trained (`conf/training`)."""

    num_epochs: Count
    batch_size: Count
    """Sequences a batch."""
    chunk_length: Count
    """Steps between updates: errors are propagated back through at most so many."""
    vision_lr: Positive
    """Learning rate of the vision model."""
    transition_lr: Positive
    """Learning rate of the transition model."""
    vision_max_norm: Positive
    """Clipping norm of the vision model's gradient, per member."""
    transition_max_norm: Positive
    """Clipping norm of the transition model's gradient, per member."""
    adam_eps: Positive
    """Adam's epsilon."""
    snapshot_epochs: tuple[Count, ...]
    """Epochs after which the weights are kept; the last epoch always is."""
    accelerator: Literal["cpu", "gpu", "auto"] = Field(exclude=True)
    """Where to train."""
