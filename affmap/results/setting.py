"""Settings of a sweep as data: the values of the keys that it varies, and how readers know these keys.

A report tells two keys apart, its factors: one on the x axis, one by colour.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from affmap.settings import Count, Line, Neutral, Number, Positive, Settings, read

Value = bool | int | float | str

STAGES = ("data", "train", "predict", "map", "control")


class PlannerName(NamedTuple):
    """The method of a planner, and its colour."""

    method: str
    """In a sentence, before "planning"."""
    color: str
    """`#rrggbb`; Okabe and Ito: told apart by everybody, and in grey."""


PLANNERS = {
    "cem": PlannerName("evolutionary-based", "#0072B2"),
    "gradient": PlannerName("gradient-based", "#E69F00"),
}
"""Kind of a planner -> its name, in the order of reports; others keep their own."""


def short_name(kind: str) -> str:
    """The abbreviation of a planner or model (`conf/report/default.yaml`): the paper's EB and GB, MLP, or its kind."""
    names: Mapping[str, str] = read("report", "default")["names"]
    return names.get(kind, kind)


class Factor(NamedTuple):
    """A key of the configuration that the settings of a sweep may differ in."""

    key: str
    column: str
    """Of tables of runs."""
    label: str
    """Of an axis, and in a sentence."""
    symbol: str = ""
    """Before a value: the C of C = 8; empty where values are names."""

    def format(self, value: Value) -> str:
        """A value with its symbol, as in C = 8."""
        text = f"{value:g}" if isinstance(value, float) else str(value)
        text = text.lower() if isinstance(value, bool) else text  # as in YAML
        return f"{self.symbol} = {text}" if self.symbol else text.replace("_", " ")


CONTEXT_SIZE = Factor("model.context_size", "context_size", "context size", "C")
PLANNER = Factor("planner", "planner", "planner")
LAYOUT = Factor("control_layout", "layout", "layout")
SPACING = Factor("lookup.spacing", "lookup_spacing", "map spacing (u)", "spacing")

ALWAYS = (LAYOUT, PLANNER, CONTEXT_SIZE)
"""Factors that every setting has a value of."""

FACTORS = {factor.key: factor for factor in (LAYOUT, PLANNER, SPACING, CONTEXT_SIZE)}
"""Key -> factor, of those that every table of runs has a column for, in the order of the columns."""


def make_factor(key: str) -> Factor:
    """The factor of a key; that of a key without a column of its own is labelled by its last part."""
    name = key.rpartition(".")[2].replace("_", " ")
    return FACTORS.get(key) or Factor(key, key.replace(".", "_"), name, name)


@dataclass(frozen=True)
class Setting:
    """One setting of a sweep: the values of the keys that it varies, and the folders of its completed stages."""

    values: Mapping[str, Value]
    """Dotted key -> value; `model.context_size`, `planner` and `control_layout` are always there, by size and name."""
    folders: Mapping[str, tuple[Path, ...]]
    """Stage -> its folder, or those of the jobs that its members were divided among, in the members' order."""

    @property
    def context_size(self) -> int:
        """C, length of the context code."""
        return int(self.values[CONTEXT_SIZE.key])

    @property
    def planner(self) -> str:
        """Kind of the planner, such as `cem`."""
        return str(self.values[PLANNER.key])

    @property
    def layout(self) -> str:
        """Name of the layout that was flown in."""
        return str(self.values[LAYOUT.key])

    @property
    def data(self) -> tuple[Path, ...]:
        """Folders of the stage `data`."""
        return self.folders["data"]

    @property
    def train(self) -> tuple[Path, ...]:
        """Folders of the stage `train`."""
        return self.folders["train"]

    @property
    def predict(self) -> tuple[Path, ...]:
        """Folders of the stage `predict`."""
        return self.folders["predict"]

    @property
    def map(self) -> tuple[Path, ...]:
        """Folders of the stage `map`."""
        return self.folders["map"]

    @property
    def control(self) -> tuple[Path, ...]:
        """Folders of the stage `control`."""
        return self.folders["control"]


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
    x: Annotated[Line | None, Neutral(None), Field(exclude=True)]
    """The key on the x axis; None for the context size or, where that is not varied, the first number that is."""
    color: Annotated[Line | None, Neutral(None), Field(exclude=True)]
    """The key that colours tell apart; None for whatever else is varied."""
    names: Mapping[Line, Line] = Field(exclude=True)
    """What planners, layouts and models are called; others keep their own names."""
    paper_figures: Annotated[Mapping[Line, Count], Neutral({}), Field(exclude=True)]
    """Figure of the report -> number of the paper's figure that it corresponds to."""
    outcome: Literal["mean_distance", "success"] = Field(exclude=True)
    """What the success of control is measured by, beside the prediction error."""
    axes: Mapping[MetricName, tuple[Number, Number]] = Field(exclude=True)
    """Metric -> lowest and highest tick of the paper's axis; it prints no result as text."""
