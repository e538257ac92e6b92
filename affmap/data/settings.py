"""The numbers of exploration, apart from the code that needs the environment (which takes a second to import)."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from affmap.settings import Count, Neutral, Seed, Settings, Share, preset


class Exploration(Settings, defaults="data/default"):
    """Settings of exploration (`conf/data`)."""

    seed: Seed = preset()
    """Seed of exploration and of the batch order."""
    num_sequences: Count = preset()
    """Sequences in each layout."""
    num_steps: Count = preset()
    """T, steps of a sequence."""
    num_validation: Count = preset()
    """Number of sequences of each layout, its last ones, for validation."""
    max_hold: Count = preset()
    """Each action is held for 1 to `max_hold` steps; longer holds reach higher speeds."""
    binary_share: Share = preset()
    """Share of the actions whose throttles are fully open or closed; the others are uniform in [0, 1]."""
    start: Annotated[Literal["free", "clear"], Neutral("free")] = preset()
    """Places where sequences start: all free ones, or only those outside fog, where the vehicle knows its place."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.num_validation >= self.num_sequences:
            raise ValueError(
                f"num_validation = {self.num_validation} leaves nothing to train on; "
                f"it must be less than num_sequences = {self.num_sequences}."
            )
        return self
