"""Named random generators derived from one seed, so that no draw depends on another (leaf).

The stream of `generator(3, "planner", 1)` is the same wherever and in whatever order it is asked for.
"""

from zlib import crc32

import numpy as np


def sequence(seed: int, name: str, *keys: int) -> np.random.SeedSequence:
    """The seed sequence of the thing called `name`, and of its part numbered by `keys`."""
    return np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()), *keys))


def generator(seed: int, name: str, *keys: int) -> np.random.Generator:
    """A NumPy generator of its own for the thing called `name`."""
    return np.random.default_rng(sequence(seed, name, *keys))


def integer(seed: int, name: str, *keys: int) -> int:
    """A seed of its own for a library that wants a single number (32 bits)."""
    return int(sequence(seed, name, *keys).generate_state(1)[0])
