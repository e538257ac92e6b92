"""Settings of a sweep as data: the values of the swept keys, and names of these keys for readers.

A report groups by two keys, its factors: one on the x axis, one by colour.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, field_validator

from affmap.settings import Count, Length, Line, Name, Neutral, Number, Settings, preset, read
from affmap.view import EXTENT

Value = bool | int | float | str

STAGES = ("data", "train", "predict", "map", "blocks", "policy", "control")
"""Kinds of stages, in order; `blocks` only of models whose codes have blocks, `policy` only of rivals."""


class PlannerName(NamedTuple):
    """The method of a planner, and its colour."""

    method: str
    """In a sentence, before "planning"."""
    color: str
    """`#rrggbb`, of the palette by Okabe and Ito: safe for colour-blind readers, and in grey."""


PLANNERS = {
    "cem": PlannerName("evolutionary-based", "#0072B2"),
    "gradient": PlannerName("gradient-based", "#E69F00"),
}
"""Kind of a planner -> its name, in the order of reports; others keep their own."""


def short_name(kind: str) -> str:
    """The abbreviation of a planner or model (`conf/report/default.yaml`): the paper's EB and GB, MLP, or its kind."""
    names: Mapping[str, str] = read("report", "default")["names"]
    return names.get(kind, kind)


def reader_name(value: str, names: Mapping[str, str]) -> str:
    """The name of a value in `names`, which are those of a report's settings; else its own, in words."""
    return names.get(value, value.replace("_", " "))


def value_name(value: float | str) -> str:
    """A value of a compared key as in tables and figures."""
    return short_name(value) if isinstance(value, str) else f"{value:g}" if abs(value) < 1e6 else f"{value:,.0f}"


class Factor(NamedTuple):
    """A key of the configuration that the settings of a sweep may differ in."""

    key: str
    column: str
    """Column in tables of runs."""
    label: str
    """Label of an axis, also in a sentence."""
    symbol: str = ""
    """Symbol before a value, such as the C of C = 8; empty if values are names."""

    def format(self, value: Value) -> str:
        """A value with its symbol, as in C = 8."""
        text = f"{value:g}" if isinstance(value, float) else str(value)
        text = text.lower() if isinstance(value, bool) else text  # as in YAML
        return f"{self.symbol} = {text}" if self.symbol else text.replace("_", " ")


CONTEXT_SIZE = Factor("model.context_size", "context_size", "context size", "C")
PLANNER = Factor("planner", "planner", "planner")
LAYOUT = Factor("control_layout", "layout", "layout")
SPACING = Factor("lookup.spacing", "lookup_spacing", "map spacing (u)", "spacing")
LEARNING = Factor("learning", "learning", "learning", "learning")

ALWAYS = (LAYOUT, PLANNER, CONTEXT_SIZE)
"""Factors of which every setting has a value."""

FACTORS = {factor.key: factor for factor in (LAYOUT, PLANNER, SPACING, CONTEXT_SIZE)}
"""Key -> factor, for those with a column in every table of runs, in the order of the columns."""


def make_factor(key: str) -> Factor:
    """The factor of a key; without a column of its own, it is labelled by the key's last part."""
    name = key.rpartition(".")[2].replace("_", " ")
    return FACTORS.get(key) or Factor(key, key.replace(".", "_"), name, name)


@dataclass(frozen=True)
class Setting:
    """One setting of a sweep: the values of the swept keys, and the folders of its completed stages."""

    values: Mapping[str, Value]
    """Dotted key -> value; always has `model.context_size`, `planner` and `control_layout`."""
    folders: Mapping[str, tuple[Path, ...]]
    """Stage -> its folder, or folders if its members were divided among jobs, in the members' order."""

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
        """Name of the layout of control."""
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
    def blocks(self) -> tuple[Path, ...]:
        """Folders of the stage `blocks`; none of models without blocks."""
        return self.folders.get("blocks", ())

    @property
    def control(self) -> tuple[Path, ...]:
        """Folders of the stage `control`."""
        return self.folders["control"]


EXPERIMENTS = Path(__file__).parents[1] / "experiments"
"""Folder of the rooms of experiments; one with a file `claims.py` has claims."""

MetricName = Literal["validation_nll", "prediction_error", "mean_distance", "success"]


class ReportSettings(Settings, defaults="report/default"):
    """Settings of reports (`conf/report`, and each experiment)."""

    map_spacing: Annotated[Length, Field(le=EXTENT)] = preset()
    """Distance between the nodes of affordance maps, at most the width of a view, u."""
    snapshots: bool = preset()
    """Whether maps are also painted with the weights kept during training."""
    compare: Line | None = preset(exclude=True)
    """A key of the configuration whose values are compared in a table; None for the report of an experiment."""
    partial: bool = preset(exclude=True)
    """Whether a report may lack settings that are not complete; every figure then says so."""
    claims: Name | None = preset(exclude=True)
    """The folder of `affmap/experiments` whose claims are tested; None for none."""
    x: Annotated[Line | None, Neutral(None), Field(exclude=True)] = preset()
    """The key on the x axis; None for the context size or, where that is not varied, the first number that is."""
    color: Annotated[Line | None, Neutral(None), Field(exclude=True)] = preset()
    """The grouping variable shown by colour; None for whatever else is varied."""
    names: Mapping[Line, Line] = preset(exclude=True)
    """Planner, layout or model -> its name for readers; others keep their own."""
    paper_figures: Annotated[Mapping[Line, Count], Neutral({}), Field(exclude=True)] = preset()
    """Figure of the report -> number of the corresponding figure in the paper."""
    outcome: Literal["mean_distance", "success"] = preset(exclude=True)
    """The metric of success in control, besides the prediction error."""
    axes: Mapping[MetricName, tuple[Number, Number]] = preset(exclude=True)
    """Metric -> lowest and highest tick of the paper's axis; the paper prints no result as text."""

    @field_validator("claims")
    @classmethod
    def _check_claims(cls, value: str | None) -> str | None:
        known = sorted(path.parent.name for path in EXPERIMENTS.glob("*/claims.py"))
        if value is not None and value not in known:
            raise ValueError(f"names no folder of affmap/experiments with claims; there are: {', '.join(known)}")
        return value

    @field_validator("names")
    @classmethod
    def _check_names(cls, value: Mapping[str, str]) -> Mapping[str, str]:
        for key, name in value.items():
            if name.startswith("_"):
                raise ValueError(f"has {name!r} for {key}; begin it with another character, since legends leave it out")
        return value

    @field_validator("axes")
    @classmethod
    def _check_axes(cls, axes: Mapping[str, tuple[float, float]]) -> Mapping[str, tuple[float, float]]:
        for metric, (low, high) in axes.items():
            if low >= high:
                raise ValueError(f"{metric} = {[low, high]} should be the lowest tick, then the highest.")
        return axes
