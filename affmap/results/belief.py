"""Beliefs of agents that do not know where they are: pure functions of recorded runs.

An agent whose reports are noisy believes to be where its next report would be on average. So the first position of each
plan, seen from a report, is the place where it believes to be after the step.
"""

import numpy as np

from affmap.results.files import Floats, Trajectories


def believed(paths: Trajectories) -> Floats:
    """Places where agents believe to be at the end of each step, `[B, T, 2]` in u; NaN where nothing is planned."""
    return paths.planned_position[:, :, 0]


def errors(paths: Trajectories) -> Floats:
    """Distances of these from where the vehicles are, `[B, T]` in u."""
    return np.asarray(np.linalg.norm(believed(paths) - paths.position[:, 1:], axis=-1))


def steps_in_fog(paths: Trajectories) -> Floats:
    """Steps since the vehicle entered fog, at the end of each step, `[B, T]`: 1 for the first, 0 outside."""
    counts = np.zeros(paths.in_fog.shape)
    for step, inside in enumerate(paths.in_fog.T):
        counts[:, step] = inside * (1 + (counts[:, step - 1] if step else 0))
    return counts


def error_after(paths: Trajectories, steps: int) -> Floats:
    """Error of each member's belief so many steps into fog, `[M]` in u, members ascending.

    The root of the mean square over all moments of its runs; NaN without one.
    """
    squares, chosen = errors(paths) ** 2, steps_in_fog(paths) == steps
    result = []
    for member in np.unique(paths.member):
        own = squares[paths.member == member][chosen[paths.member == member]]
        result.append(np.sqrt(own.mean()) if len(own) else np.nan)
    return np.array(result)
