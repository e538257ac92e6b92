"""Weights of a stack as files: safetensors, so that reading an untrusted file executes nothing."""

from pathlib import Path

from safetensors.torch import load_file, save_file
from torch import Tensor

from affmap.model.stack import Stack
from affmap.store.files import guarded_read

WEIGHTS = "weights.safetensors"

SNAPSHOT = "weights-epoch-{epoch}.safetensors"
"""File of the weights saved after an epoch of training."""


def copy(stack: Stack) -> dict[str, Tensor]:
    """Copy the present weights of a stack, `[M, ...]` each."""
    return {name: tensor.detach().cpu().clone().contiguous() for name, tensor in stack.state_dict().items()}


def save(weights: dict[str, Tensor], path: Path) -> None:
    """Write weights to a file."""
    save_file(weights, path)


def restore(stack: Stack, path: Path) -> Stack:
    """Load the weights at `path` into a stack.

    Raises:
        ConfigError: the file is corrupted, or holds the weights of another stack.
    """
    with guarded_read(path):
        stack.load_state_dict(load_file(path))
    return stack.eval()
