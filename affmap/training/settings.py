"""Settings of training, in a module without Lightning, which takes seconds to import."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Tag, model_validator

from affmap.settings import Count, Neutral, Positive, Settings, Share, preset


def _kind(value: Any) -> str:
    return "trials" if isinstance(value, (list, tuple)) else "number"


def _not_empty(values: tuple[float, ...]) -> tuple[float, ...]:
    if not values:
        raise ValueError("needs a number, or one for each trial")
    return values


PerTrial = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[tuple[Positive, ...], AfterValidator(_not_empty), Tag("trials")],
    Discriminator(_kind),  # one error message, for the kind of value that was given
]
"""A number for all trials, or one for each of R trials."""


class TrainingSettings(Settings, defaults="training/default"):
    """Settings of training (`conf/training`).

    A list instead of a number makes a training of R trials with the same members and data, which differ in the listed
    values.
    """

    num_epochs: Count = preset()
    """Passes through the data."""
    batch_size: Count = preset()
    """Sequences a batch."""
    chunk_length: Count = preset()
    """Steps between updates: errors are propagated back through at most this many."""
    vision_lr: PerTrial = preset()
    """Learning rate of the vision model."""
    transition_lr: PerTrial = preset()
    """Learning rate of the transition model."""
    vision_max_norm: PerTrial = preset()
    """Clipping norm of the vision model's gradient, per member."""
    transition_max_norm: PerTrial = preset()
    """Clipping norm of the transition model's gradient, per member."""
    adam_eps: Positive = preset()
    """Adam's epsilon."""
    cooldown: Annotated[Share, Neutral(0.0)] = preset()
    """Share of the epochs, the last ones, in which the learning rates fall exponentially to a tenth."""
    snapshot_epochs: tuple[Count, ...] = preset()
    """Epochs after which the weights are saved, beside the last epoch."""
    accelerator: Literal["cpu", "gpu", "auto"] = preset(exclude=True)
    """Device for training."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key, values in self.per_trial.items():
            if len(values) != self.num_trials:
                raise ValueError(
                    f"{next(iter(self.per_trial))} has {self.num_trials} values, but {key} has {len(values)}; "
                    "lists need one for each trial."
                )
        return self

    @property
    def per_trial(self) -> dict[str, tuple[float, ...]]:
        """Keys with a value for each trial -> these values; empty without trials."""
        keys = ("vision_lr", "transition_lr", "vision_max_norm", "transition_max_norm")
        return {key: value for key in keys if isinstance(value := getattr(self, key), tuple)}

    @property
    def num_trials(self) -> int | None:
        """Number of trials, R; None without trials."""
        return next((len(values) for values in self.per_trial.values()), None)
