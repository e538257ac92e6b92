"""Timing side by side: contenders take turns, and what counts is the ratio of neighbouring times.

The machines that this runs on are shared and change their speed by the minute; a ratio of two times taken right after
each other hardly does. Times are those that the process spends computing, not waiting for a core that others use. A
large matrix product is timed in each round as well: what share of it the useful arithmetic of a contender reaches says
how much could be left to gain.
"""

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import NamedTuple

import torch


class Contender(NamedTuple):
    """One way of doing a piece of work."""

    name: str
    run: Callable[[], object]
    units: float
    """How many units of the work a call does."""


class Result(NamedTuple):
    """What was measured of one contender."""

    work: str
    unit: str
    contender: str
    seconds: float
    """Median CPU time of a unit."""
    ratio: float
    """Median over rounds of this contender's time of a unit over that of the first contender; above 1: slower."""
    ratio_low: float
    """Smallest and"""
    ratio_high: float
    """largest of these ratios."""
    share_of_limit: float | None
    """Useful floating-point operations a second over those of a large matrix product, where they can be counted. Useful
    is what the plain way of doing it would compute; who gets by with less can exceed what its processor does."""


def compare(
    work: str, unit: str, contenders: Sequence[Contender], flop: float | None = None, rounds: int = 7
) -> list[Result]:
    """Time `contenders` in turns, after a call of each to warm up.

    Args:
        work: what is done, in a few words.
        unit: what a unit of it is, such as "model and update".
        contenders: the first is the one that the others are compared with.
        flop: useful floating-point operations of a unit (a multiplication and an addition are two).
        rounds: how often each has its turn.
    """
    for contender in contenders:
        contender.run()
    seconds: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    limits = []
    for _ in range(rounds):
        limits.append(limit())
        for contender in contenders:
            seconds[contender.name].append(elapsed(contender.run) / contender.units)
    first = seconds[contenders[0].name]
    results = []
    for name, times in seconds.items():
        ratios = [own / reference for own, reference in zip(times, first, strict=True)]
        shares = [flop / own / most for own, most in zip(times, limits, strict=True)] if flop else []
        share = median(shares) if shares else None
        results.append(Result(work, unit, name, median(times), median(ratios), min(ratios), max(ratios), share))
    return results


def elapsed(run: Callable[[], object]) -> float:
    """CPU seconds of a call."""
    start = time.process_time()
    run()
    return time.process_time() - start


def limit(size: int = 1024) -> float:
    """Floating-point operations a second of a product of two square matrices, with torch's present threads."""
    matrix = torch.rand(size, size)
    return 2 * size**3 / min(elapsed(lambda: matrix @ matrix) for _ in range(3))
