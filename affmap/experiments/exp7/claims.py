"""The claims of Experiment VII, beyond the horizon. They are not the paper's, which names the limit that they test."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd

from affmap.env.geometry import way_length
from affmap.results import claims, statistics
from affmap.results.claims import Claim, Criterion, Pair
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.setting import LAYOUT, make_factor
from affmap.results.tables import Results, score_matrix

LOOKAHEAD = make_factor("lookahead")
"""The agents."""

GREEDY, GUIDED = ("horizon_20", "horizon_40", "horizon_80"), "time_to_go"
"""Agents."""

DEAD_ENDS = ("trap", "rooms", "spiral")
"""Layouts whose shortest way leads away from the goal."""

EASY, HARD = "procedural_easy", "procedural_hard"
"""Layouts of Experiment V."""

STUCK, ARRIVES = 0.3, 0.95
"""Shares of successful runs."""

MARGIN = 0.03
"""Loss of success in easy worlds that would not matter: three runs of a hundred."""


def select(results: Results, agent: str, layout: str) -> pd.DataFrame:
    """Runs of an agent in a layout."""
    runs = claims.select_runs(results, layout)
    return runs[runs[LOOKAHEAD.column] == agent] if LOOKAHEAD.column in runs else runs.iloc[:0]


def shares(runs: pd.DataFrame) -> pd.Series:
    """Share of successful runs of each member."""
    return score_matrix(runs, "success").iloc[:, 0].astype(float) if len(runs) else pd.Series(dtype=float)


def stuck(results: Results, layouts: Sequence[str], agents: Sequence[str]) -> list[Criterion]:
    """Test that fewer than `STUCK` of the runs of greedy agents succeed in some layouts."""
    criteria = []
    for layout in layouts:
        for agent in agents:
            outcome = statistics.below(shares(select(results, agent, layout)), STUCK)
            steps = agent.removeprefix("horizon_")
            world = results.name(layout)
            says = f"{world}: fewer than {STUCK:g} of the runs succeed with a horizon of {steps} steps."
            criteria.append(Criterion(f"{world}, {steps}", "share", METRICS["success"].unit, outcome, says))
    return criteria


def arrives(results: Results, layouts: Sequence[str], level: float) -> list[Criterion]:
    """Test that at least `level` of the runs of agents with a map succeed in some layouts."""
    criteria = []
    for layout in layouts:
        runs = select(results, GUIDED, layout)
        outcome = statistics.at_least(shares(runs), level)
        outcome = claims.with_note(outcome, _times(results, layout))
        world = results.name(layout)
        says = f"{world}: at least {level:g} of the runs succeed."
        criteria.append(Criterion(world, "share", METRICS["success"].unit, outcome, says))
    return criteria


def _times(results: Results, layout: str) -> list[str]:
    """A note about the times of runs that arrive, beside those of the shortest ways at top speed."""
    settings = results.where({LOOKAHEAD.key: GUIDED, LAYOUT.key: layout})
    if not settings:
        return []
    paths, vehicle = results.trajectories(settings[0]), results.vehicle(settings[0])
    steps = select(results, GUIDED, layout)["steps_to_reach"].dropna()
    places = zip(results.run_layouts(settings[0]), paths.position[:, 0], paths.goal, strict=True)
    least = [way_length(world, vehicle.radius, start, goal) / vehicle.top_speed for world, start, goal in places]
    arrived = f"median time {number(float(steps.median()), 0)} steps, " if len(steps) else ""
    return [f"{arrived}the shortest ways take at least {number(float(np.median(least)), 0)} at top speed"]


def _beats(results: Results, layouts: tuple[str, ...], than: tuple[str, ...]) -> list[Criterion]:
    criteria = []
    for layout in layouts:
        for agent in than:
            runs = pd.concat([select(results, each, layout) for each in (GUIDED, agent)])
            outcome = claims.paired(runs, "success", Pair(LOOKAHEAD.column, GUIDED, agent), "higher")
            steps = agent.removeprefix("horizon_")
            world = results.name(layout)
            says = f"{world}: more runs succeed than with a horizon of {steps} steps."
            effect_of = f"time to go minus {steps} steps"
            criteria.append(Criterion(f"{world}, {steps}", effect_of, METRICS["success"].unit, outcome, says))
    return criteria


def _not_worse(results: Results) -> list[Criterion]:
    """Test that the lower end of the interval of the difference is above the margin."""
    guided, greedy = (shares(select(results, agent, EASY)) for agent in (GUIDED, GREEDY[0]))
    difference = (guided - greedy).to_numpy(float) if len(guided) and len(greedy) else np.empty(0)
    outcome = statistics.at_least(difference, -MARGIN)
    note = f"{number(guided.mean())} against {number(greedy.mean())}" if len(difference) else ""
    effect_of = "time to go minus 20 steps"
    return [Criterion("", effect_of, METRICS["success"].unit, claims.with_note(outcome, [note]))]


CLAIMS = (
    Claim(
        "VII-1",
        f"Greedy agents are stuck in dead ends: fewer than {STUCK:g} of their runs succeed, with any horizon.",
        partial(stuck, layouts=DEAD_ENDS, agents=GREEDY),
    ),
    Claim(
        "VII-2",
        f"With a map of times to go, at least {ARRIVES:g} of the runs succeed there.",
        partial(arrives, layouts=DEAD_ENDS, level=ARRIVES),
    ),
    Claim(
        "VII-3",
        "In dead ends, the map brings more runs to the goal than a horizon four times as long.",
        partial(_beats, layouts=DEAD_ENDS, than=GREEDY[-1:]),
    ),
    Claim(
        "VII-4",
        f"In easy worlds of Experiment V, the map costs no success: at most {MARGIN:g}, by its 95 % interval.",
        _not_worse,
    ),
    Claim(
        "VII-5",
        "In hard worlds of Experiment V, the map brings more runs to the goal than the same horizon without it.",
        partial(_beats, layouts=(HARD,), than=GREEDY[:1]),
    ),
)
