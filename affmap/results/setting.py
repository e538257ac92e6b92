"""What a report is to show, apart from the code that draws it (which takes seconds to import)."""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from affmap.settings import Line, Number, Positive, Settings

MetricName = Literal["validation_nll", "prediction_error", "mean_distance", "success"]


class ReportSettings(Settings):
    """What reports draw and test (`conf/report`, and each experiment)."""

    map_spacing: Positive
    """Distance between the nodes of the affordance maps that are drawn and examined, u."""
    snapshots: bool
    """Whether maps are also painted with the weights kept during training."""
    compare: Line | None = Field(exclude=True)
    """A key of the configuration whose values are compared in a table; None for the report of an experiment."""
    partial: bool = Field(exclude=True)
    """Whether a report is wanted though some settings are not complete; it says so on every figure."""
    claims: Literal["exp1", "exp2", "exp3", "exp4", "exp5"] | None = Field(exclude=True)
    """The experiment of the paper whose claims are tested; None for an experiment that the paper does not have."""
    names: Mapping[Line, Line] = Field(exclude=True)
    """What planners and layouts are called; others keep their own names."""
    outcome: Literal["mean_distance", "success"] = Field(exclude=True)
    """What the success of control is measured by, beside the prediction error."""
    axes: Mapping[MetricName, tuple[Number, Number]] = Field(exclude=True)
    """Metric -> lowest and highest tick of the paper's axis; it prints no result as text."""
