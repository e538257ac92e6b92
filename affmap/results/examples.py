"""Which runs and moments are shown: chosen by a rule, because the best ones would say little."""

from typing import NamedTuple

import numpy as np

from affmap.results.files import Job, Trajectories
from affmap.results.tables import Results

EXAMPLE_RULE = (
    "the first member, of its runs in a layout the one whose mean distance to the goal, averaged over the context "
    "sizes shown, is the lower median, and the first step at which at most half of the initial distance is left (where "
    "that never happens: the step that comes closest)"
)
"""How the runs and moments that are shown are chosen."""


class Example(NamedTuple):
    """A run of one setting, chosen by `EXAMPLE_RULE`."""

    job: Job
    member: int
    run: int
    problem: int
    """Its place among the B runs in `paths`."""
    step: int
    paths: Trajectories


def choose_examples(results: Results, layout: str) -> list[Example]:
    """The runs in a layout that are shown, by `EXAMPLE_RULE`; of EB, or of GB where that alone was run."""
    planner = results.planners[0]
    run = middle_runs(results, layout)[0]
    examples = []
    for job in filter(None, (results.job(size, planner, layout) for size in _sizes(results, layout))):
        paths = results.trajectories(job)
        member, index = first_member(paths, run)
        examples.append(Example(job, member, run, index, half_way(paths, index), paths))
    return examples


def middle_runs(results: Results, layout: str) -> list[int]:
    """Numbers of the first member's runs in a layout: the one that `EXAMPLE_RULE` chooses, then its next in rank."""
    runs = results.runs[(results.runs["planner"] == results.planners[0]) & (results.runs["layout"] == layout)]
    runs = runs[runs["context_size"].isin(_sizes(results, layout)) & (runs["member"] == runs["member"].min())]
    distances = runs.groupby("run")["mean_distance"].mean().sort_values(kind="stable")
    away = np.abs(np.arange(len(distances)) - (len(distances) - 1) // 2)  # ranks from the lower median
    return [int(distances.index[rank]) for rank in np.argsort(away, kind="stable")]


def first_member(paths: Trajectories, run: int) -> tuple[int, int]:
    """The first member, and the place of one of its runs among the B."""
    member = int(paths.member.min())
    return member, int(np.flatnonzero((paths.member == member) & (paths.run == run))[0])


def half_way(paths: Trajectories, index: int) -> int:
    """First step with at most half of the initial distance left; where there is none, the closest one."""
    steps = paths.planned_position.shape[1]
    distance = np.linalg.norm(paths.position[index, :steps] - paths.goal[index], axis=-1)  # [T]
    arrived = distance <= distance[0] / 2
    return int(arrived.argmax() if arrived.any() else distance.argmin())


def _sizes(results: Results, layout: str) -> list[int]:
    """The smallest and the largest context size of the first planner in a layout."""
    runs = results.runs[(results.runs["planner"] == results.planners[0]) & (results.runs["layout"] == layout)]
    return sorted({int(runs["context_size"].min()), int(runs["context_size"].max())})
