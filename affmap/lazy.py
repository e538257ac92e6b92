"""Slow imports on first use only, so that settings are validated without them (leaf).

`notebook` is `affmap.plot.notebook`, which draws worlds, maps, agents and runs, and stands above them. Only its name is
known here, so that they can show themselves in a notebook and know nothing of Matplotlib.

`importlib.util.LazyLoader` does not serve: it puts torch into `sys.modules`, where SciPy finds it and so imports it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import torch as torch
    from scipy import stats as stats

    notebook: Any
else:

    class _Library:
        """A module that is imported when its first attribute is used."""

        def __init__(self, name: str) -> None:
            self._name = name

        def __getattr__(self, attribute: str) -> Any:
            value = getattr(import_module(self._name), attribute)
            setattr(self, attribute, value)  # bypasses this method from now on
            return value

    torch, stats, notebook = _Library("torch"), _Library("scipy.stats"), _Library("affmap.plot.notebook")
