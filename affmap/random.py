"""Named random generators derived from one seed, so that no draw depends on another (leaf).

The stream of `generator(3, "planner", 1)` does not depend on where or in which order it is created.
"""

from zlib import crc32

import numpy as np


def sequence(seed: int, name: str, *keys: int) -> np.random.SeedSequence:
    """The seed sequence of the thing called `name`, and of its part numbered by `keys`."""
    return np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()), *keys))


def generator(seed: int, name: str, *keys: int) -> np.random.Generator:
    """A NumPy generator for the thing called `name` alone."""
    return np.random.default_rng(sequence(seed, name, *keys))


def integer(seed: int, name: str, *keys: int) -> int:
    """A seed for the thing called `name` alone, for libraries that want a single number (32 bits)."""
    return int(sequence(seed, name, *keys).generate_state(1)[0])
