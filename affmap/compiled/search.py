"""The two halves of an iteration of the cross-entropy method: drawing candidates and learning from the best.

The reference is `affmap.planning.cem`, in PyTorch. Arrays are float32 and contiguous; J numbers are an action sequence.
"""

import numpy as np

from affmap.compiled.functions import erf, erf_inverse
from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import WIDTH, at_least, at_most, fma, keep, load, pointer, root, splat, store

Array = np.ndarray
f32 = np.float32

SQRT_2 = f32(np.sqrt(2))
TINY = f32(np.finfo(f32).tiny ** 0.5)


@compiled
def draw(mean: Array, variance: Array, kept: Array, uniform: Array, candidates: Array) -> None:
    """Draw from normal distributions, given that all lies in [0, 1], by their quantile functions.

    Args:
        mean: `[B, J]` in [0, 1].
        variance: `[B, J]`
        kept: `[B, K, J]`, the first candidates as they are.
        uniform: `[B, N, J]` in [0, 1), for drawing the others.
        candidates: `[B, K + N, J]`, filled.
    """
    num_problems, num_drawn, length = uniform.shape
    num_kept = kept.shape[1]
    width = (length + WIDTH - 1) // WIDTH * WIDTH
    buffers = np.zeros(5 * width, f32)
    center, std = pointer(buffers), pointer(buffers[width:])
    low, range_ = pointer(buffers[2 * width :]), pointer(buffers[3 * width :])
    row = pointer(buffers[4 * width :])
    for b in range(num_problems):
        candidates[b, :num_kept] = kept[b]
        for j in range(length):
            center[j] = mean[b, j]
            std[j] = variance[b, j]
        for j in range(0, width, WIDTH):
            middle, deviation = load(center, j), at_least(root(load(std, j)), splat(TINY))
            deviation = deviation * splat(SQRT_2)
            first = erf((splat(f32(0)) - middle) / deviation)
            store(std, j, deviation)
            store(low, j, first)
            store(range_, j, erf((splat(f32(1)) - middle) / deviation) - first)
        for n in range(num_drawn):
            source, target = pointer(uniform[b, n]), pointer(candidates[b, num_kept + n])
            for j in range(length):
                row[j] = source[j]
            for j in range(0, width, WIDTH):
                z = erf_inverse(fma(load(row, j), load(range_, j), load(low, j)))
                value = fma(load(std, j), z, load(center, j))
                store(row, j, at_most(at_least(value, splat(f32(0))), splat(f32(1))))
            for j in range(length):
                target[j] = row[j]
    keep(buffers)


@compiled
def learn(
    candidates: Array, costs: Array, momentum: float, mean: Array, variance: Array, elites: Array, best: Array
) -> None:
    """Find the candidates of least cost, and move the distribution to them.

    A problem without a finite cost keeps its distribution.

    Args:
        candidates: `[B, N, J]`
        costs: `[B, N]`; others than finite ones count as infinite.
        momentum: weight of the old mean and variance.
        mean: `[B, J]`, changed.
        variance: `[B, J]`, changed.
        elites: `[B, E, J]`, filled with the best candidates, the very best first.
        best: `[B, E]`, filled with their costs.
    """
    num_problems, _, length = candidates.shape
    num_elites = elites.shape[1]
    share_old = f32(momentum)
    places = np.empty(num_elites, np.int64)
    for b in range(num_problems):
        _sort(costs[b], best[b], places)
        usable = 0
        for e in range(num_elites):
            elites[b, e] = candidates[b, places[e]]
            usable += np.isfinite(best[b, e])
        if usable == 0:
            continue
        share = f32(1) / f32(usable)
        for j in range(length):
            middle = f32(0)
            for e in range(usable):
                middle += share * elites[b, e, j]
            spread = f32(0)
            for e in range(usable):
                spread += share * (elites[b, e, j] - middle) ** 2
            mean[b, j] = middle + share_old * (mean[b, j] - middle)
            variance[b, j] = spread + share_old * (variance[b, j] - spread)


@inlined
def _sort(costs: Array, best: Array, places: Array) -> None:
    """Write the least costs in ascending order into `best`, and their indices into `places`."""
    count = 0
    for n in range(len(costs)):
        cost = costs[n] if np.isfinite(costs[n]) else f32(np.inf)
        if count == len(best) and not cost < best[count - 1]:
            continue
        count = min(count + 1, len(best))
        place = count - 1
        while place > 0 and cost < best[place - 1]:
            best[place], places[place] = best[place - 1], places[place - 1]
            place -= 1
        best[place], places[place] = cost, n
