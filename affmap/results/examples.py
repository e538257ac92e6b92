"""Example runs and moments, chosen by a rule, because the best ones would say little."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd

from affmap.results.files import Trajectories
from affmap.results.provenance import distinct
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, Setting, Value, make_factor
from affmap.results.tables import Results

T = TypeVar("T")


def example_rule(results: Results) -> str:
    """The rule by which runs and moments are chosen, as part of a sentence."""
    richest = " (of those in whose worlds circles do most different things)" if results.has_own_layouts() else ""
    values = "context sizes" if results.x == CONTEXT_SIZE else f"values of {results.x.label}"
    return (
        f"the first member, of its runs in a layout{richest} the one whose mean distance to the goal, averaged "
        f"over the {values} shown, is the lower median, and the first step at which at most half of the initial "
        "distance is left (where that never happens: the step that comes closest)"
    )


class Example(NamedTuple):
    """A run of one setting, chosen by `example_rule`."""

    setting: Setting
    member: int
    run: int
    problem: int
    """Its index among the B runs in `paths`."""
    step: int
    paths: Trajectories


MAX_ROWS = 3
"""Rows of a figure, so that it fits a page."""


MAX_NAMES = 3
"""Names on the x axis of which moments stand side by side; of numbers, those at both ends."""


def first_and_last(values: Sequence[T], count: int) -> list[T]:
    """The first of some values, such as the paper's model, and the last ones, such as the newest; `count` in all."""
    return [*values] if len(values) <= count else [values[0], *values[1 - count :]]


def rows(results: Results) -> list[dict[str, Value]]:
    """The common values of the settings in each row of pictures, of the first planner (EB where it was run).

    A row is a layout or, where colour shows another key, a value of that; the first `MAX_ROWS` of them. The key on the
    x axis varies within a row.
    """
    first: dict[str, Value] = {PLANNER.key: results.planners[0], LAYOUT.key: results.layouts[0]}
    key = LAYOUT.key if results.color == PLANNER else results.color.key
    values: Sequence[Value] = results.layouts if key == LAYOUT.key else results.color_values
    every = [{**first, key: value} for value in values]
    return distinct([{other: row[other] for other in row if other != results.x.key} for row in every])[:MAX_ROWS]


def choose_examples(results: Results, row: Mapping[str, Value]) -> list[Example]:
    """The example runs of a row of `rows`, by `example_rule`."""
    layout = str(row.get(LAYOUT.key, results.layouts[0]))
    run = middle_runs(results, layout)[0]
    ends = _ends(results, layout)
    examples = []
    for setting in results.where(row):
        if setting.values[results.x.key] in ends:
            paths = results.trajectories(setting)
            member, index = first_member(paths, run)
            examples.append(Example(setting, member, run, index, half_way(paths, index), paths))
    return sorted(examples, key=lambda example: results.x_values.index(example.setting.values[results.x.key]))


def middle_runs(results: Results, layout: str) -> list[int]:
    """Numbers of the first member's runs in a layout: the one chosen by `example_rule`, then the next in rank."""
    runs = results.runs
    for key, value in _first(results, layout).items():
        runs = runs[runs[make_factor(key).column] == value]
    runs = runs[runs[results.x.column].isin(_ends(results, layout)) & (runs["member"] == runs["member"].min())]
    distances = runs.groupby("run")["mean_distance"].mean().sort_values(kind="stable")
    groups = distances.groupby(_num_effects(results, layout))
    return [run for _, group in sorted(groups, reverse=True) for run in _from_the_middle(group)]


def _num_effects(results: Results, layout: str) -> dict[int, int]:
    """Run of the first member -> number of distinct effects in its layout."""
    setting = results.where(_first(results, layout))[0]
    paths, layouts = results.trajectories(setting), results.run_layouts(setting)
    indices = np.flatnonzero(paths.member == paths.member.min())
    return {int(paths.run[index]): len({circle.effect for circle in layouts[index].circles}) for index in indices}


def _from_the_middle(distances: "pd.Series[float]") -> list[int]:
    """Runs sorted by distance -> the lower median run, then the next in rank."""
    away = np.abs(np.arange(len(distances)) - (len(distances) - 1) // 2)
    return [int(distances.index[rank]) for rank in np.argsort(away, kind="stable")]


def first_member(paths: Trajectories, run: int) -> tuple[int, int]:
    """The first member, and the index of one of its runs among the B."""
    member = int(paths.member.min())
    return member, int(np.flatnonzero((paths.member == member) & (paths.run == run))[0])


def half_way(paths: Trajectories, index: int) -> int:
    """The first step with at most half of the initial distance left; the closest one if there is none."""
    steps = paths.planned_position.shape[1]
    distance = np.linalg.norm(paths.position[index, :steps] - paths.goal[index], axis=-1)  # [T]
    is_half_way = distance <= distance[0] / 2
    return int(is_half_way.argmax() if is_half_way.any() else distance.argmin())


def _first(results: Results, layout: str) -> dict[str, Value]:
    """The values of the first planner in a layout, without the key on the x axis."""
    values: dict[str, Value] = {PLANNER.key: results.planners[0], LAYOUT.key: layout}
    return {key: value for key, value in values.items() if key != results.x.key}


def _ends(results: Results, layout: str) -> list[Value]:
    """The first and the last value on the x axis, or the last two names, of the first planner in a layout."""
    own = {setting.values[results.x.key] for setting in results.where(_first(results, layout))}
    values = [value for value in results.x_values if value in own]
    return first_and_last(values, MAX_NAMES if isinstance(values[0], str) else 2)
