"""Affordance maps and active inference in simulated agents.

    >>> agent = affmap.load("exp1")  # trained, of the published run; affmap.train trains one
    >>> runs = affmap.fly(agent, "original")
    >>> runs.table[["member", "run", "reached", "mean_distance"]]
    >>> affmap.plot.trajectories(runs)

`affmap.evaluate` compares agents, and `affmap.score` gives any agent one number under a protocol that is the same for
everybody. `affmap.CEMPlanner`, `affmap.Vehicle` and others are settings: a call takes keys that are left out from the
files of `conf`. The `register_` functions make planners, agents and others of your own known.

Axes in docstrings: M members, B problems (agents, member-major), N candidates, H planning horizon, T recorded time,
K channels of the view, C context code. Lengths are in units (u), the arena is 3 u x 2 u; likelihoods are in nats.

Importing it registers the environments with Gymnasium (`affmap/Vehicle-v0` and one for each layout), whichever of the
two is imported first. Everything else is imported on first use.
"""

import os
from typing import Any

from affmap.env.registration import register_when_needed
from affmap.lazy import attach

_import, __dir__, __all__ = attach(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    return _import(name)


os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it would head the output of every command
register_when_needed()
