"""The metrics of the tables: their names, units, and what is typical of them (leaf)."""

from typing import Literal, NamedTuple

Statistic = Literal["mean", "median"]


class Metric(NamedTuple):
    """A column of the tables."""

    name: str
    """In a sentence."""
    unit: str
    label: str
    """Of an axis."""
    statistic: Statistic = "mean"
    """What of the members' differences is an effect; likelihoods have heavy tails, one run may outweigh all others."""
    margin: float | None = None
    """A difference that would not matter: small against those between context sizes."""


METRICS = {
    "validation_nll": Metric("validation loss", "nats", "validation NLL (nats)", "median", 0.5),
    "prediction_error": Metric("prediction error", "nats", "prediction error (nats)", "median", 0.5),
    "mean_distance": Metric("mean distance", "u", "mean distance to the goal (u)", margin=0.05),
    "reached": Metric("reached", "share", "share of runs that reached the goal", margin=0.05),
    "success": Metric("success", "share", "share of successful runs", margin=0.05),
    "steps_touching": Metric("steps touching", "steps", "steps touching a surface"),
}
"""Column -> metric. `success`: reached the goal and never was in fog."""
