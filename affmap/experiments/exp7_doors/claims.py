"""The claims of Experiment VII about keys and doors: a way whose first part changes the world."""

from functools import partial

import numpy as np
import pandas as pd

from affmap.env.geometry import circle_distance
from affmap.env.layout import Layout
from affmap.experiments.exp7.claims import GUIDED, LOOKAHEAD, STUCK, arrives, stuck
from affmap.results import statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.setting import LAYOUT
from affmap.results.tables import Results

LAYOUTS, GREEDY, ARRIVES = ("doors",), ("horizon_20", "horizon_80"), 0.9


def opened_before_passing(path: Floats, layout: Layout) -> bool:
    """Whether a vehicle on a path `[T, 2]` (u) was at a key before its centre was where a door is, and was there."""
    between = np.linspace(path[:-1], path[1:], 10)  # [10, T - 1, 2]: a fast vehicle jumps over a door
    doors = [circle_distance(between, circle) < 0 for circle in layout.circles if circle.effect == "door"]
    passing = np.any(doors, axis=(0, 1))
    return bool(passing.any() and layout.are_open(path)[passing.argmax()])


def _key_first(results: Results) -> list[Criterion]:
    """Test that all runs of each member that arrive with a map were at a key before a door."""
    members, first = [], []
    for setting in results.where({LOOKAHEAD.key: GUIDED, LAYOUT.key: LAYOUTS[0]}):
        paths, layouts = results.trajectories(setting), results.run_layouts(setting)
        for number in np.flatnonzero(paths.reached.any(axis=1)):
            members.append(paths.member[number])
            first.append(opened_before_passing(paths.position[number], layouts[number]))
    shares = pd.Series(first, dtype=float).groupby(members).mean()
    return [Criterion("", "share", METRICS["success"].unit, statistics.at_least(shares, 1.0))]


CLAIMS = (
    Claim(
        "VII-6",
        f"Greedy agents stay at a door: fewer than {STUCK:g} of their runs succeed, with either horizon.",
        partial(stuck, layouts=LAYOUTS, agents=GREEDY),
    ),
    Claim(
        "VII-7",
        f"With a map of times to go, at least {ARRIVES:g} of the runs succeed there.",
        partial(arrives, layouts=LAYOUTS, level=ARRIVES),
    ),
    Claim("VII-8", "All runs that arrive with the map have been at a key before they pass a door.", _key_first),
)
