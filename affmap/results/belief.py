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


def noise_share(errors: Floats, noise: Floats) -> Floats:
    """Share of the noise of reports in the errors of beliefs, by least squares: `[M]`; NaN without noise.

    Args:
        errors: `[M, N, 2]`, u.
        noise: `[N, 2]`, u.
    """
    power = np.square(noise).sum()
    return np.asarray((errors * noise).sum((1, 2)) / (power if power else np.nan))


def filter_error(gain: Floats, noise_std: float) -> Floats:
    """Error in the long run of a filter that knows each step and moves its belief towards reports, `[...]` in u.

    Args:
        gain: share of the way to the report, 0 to 1.
        noise_std: standard deviation of each reported coordinate, u.
    """
    return noise_std * np.sqrt(2 * gain / (2 - gain))


def speeds_in_fog(paths: Trajectories) -> Floats:
    """Mean length of each member's steps that end in fog, `[M]` in u, members ascending; NaN without one."""
    lengths = np.linalg.norm(np.diff(paths.position, axis=1), axis=-1)
    own = [lengths[paths.member == member][paths.in_fog[paths.member == member]] for member in np.unique(paths.member)]
    return np.array([steps.mean() if len(steps) else np.nan for steps in own])
