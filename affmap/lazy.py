"""torch, imported on first use: that takes more than a second, and settings are checked without it (leaf)."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch as torch
else:
    import lazy_loader

    torch = lazy_loader.load("torch")
