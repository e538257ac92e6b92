"""The number of PyTorch's threads, for a while."""

from collections.abc import Iterator
from contextlib import contextmanager

from affmap.lazy import torch
from affmap.settings.messages import ConfigError, format_value


@contextmanager
def limited(number: int) -> Iterator[None]:
    """Let PyTorch compute with a number of threads in the block, and with as many as before after it.

    A step of a flight consists of many small operations. Threads on all cores wait for each other at each of them, the
    longer the busier the cores are.

    Raises:
        ConfigError: the number is no whole number, or less than 1.
    """
    if not isinstance(number, int) or number < 1:
        raise ConfigError(f"threads = {format_value(number)} is not allowed; give a whole number, 1 or more.")
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)
