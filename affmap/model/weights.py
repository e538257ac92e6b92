"""The weights of a stack as files: safetensors, so that reading a stranger's file executes nothing."""

from pathlib import Path

from safetensors.torch import load_file, save_file
from torch import Tensor

from affmap.model.stack import Stack
from affmap.store.files import guarded_read

WEIGHTS = "weights.safetensors"

SNAPSHOT = "weights-epoch-{epoch}.safetensors"
"""Weights kept during training."""


def copy(stack: Stack) -> dict[str, Tensor]:
    """The weights of a stack as they are now, `[M, ...]` each."""
    return {name: tensor.detach().cpu().clone().contiguous() for name, tensor in stack.state_dict().items()}


def save(weights: dict[str, Tensor], path: Path) -> None:
    """Write weights to a file."""
    save_file(weights, path)


def restore(stack: Stack, path: Path) -> Stack:
    """Give a stack the weights at `path`.

    Raises:
        ConfigError: the file is not what it should be, or holds the weights of another stack.
    """
    with guarded_read(path):
        stack.load_state_dict(load_file(path))
    return stack.eval()
