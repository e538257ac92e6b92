"""Files that a run has left, perhaps somebody else's: reading executes nothing in them, and damage is told (leaf)."""

import pickle
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from safetensors import SafetensorError

from affmap.errors import ConfigError, one_line

DAMAGE = (
    *(OSError, EOFError, ValueError, LookupError, TypeError, RuntimeError),
    *(BadZipFile, zlib.error, pickle.UnpicklingError, SafetensorError),
)
"""What readers of arrays, tables, weights, checkpoints and JSON raise where a file is not what it should be."""


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Around what reads a file of a stage's folder, and does nothing else.

    Raises:
        ConfigError: the file is not what it should be; the message names it and says what to do.
    """
    try:
        yield
    except ConfigError:
        raise
    except DAMAGE as error:
        reason = one_line(str(error) or type(error).__name__, 200).rstrip(".")
        raise ConfigError(
            f"{path} cannot be read ({reason}): it is damaged or not ours; remove its folder and run again."
        ) from None


def arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an `.npz`; none may hold Python objects, which would be pickled code.

    Raises:
        ConfigError: the file is not what it should be.
    """
    with reading(path), path.open("rb") as file, np.load(file, allow_pickle=False) as found:
        return {name: found[name] for name in found.files}
