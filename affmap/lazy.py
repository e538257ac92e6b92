"""Slow imports on first use only, so that settings are validated without them (leaf).

`notebook` is `affmap.plot.notebook`, which draws worlds, maps, agents and runs, and stands above them. Only its name is
known here, so that they can show themselves in a notebook and know nothing of Matplotlib.

`importlib.util.LazyLoader` does not serve: it puts torch into `sys.modules`, where SciPy finds it and so imports it.
"""

from collections.abc import Callable
from difflib import get_close_matches
from importlib import import_module
from typing import TYPE_CHECKING, Any

import lazy_loader

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


def attach(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, whose names are imported on first use.

    Args:
        package: its name.
        file: its `__init__.py`; the stub beside it lists the names.
    """
    find, list_names, names = lazy_loader.attach_stub(package, file)

    def get(name: str) -> Any:
        if name in names:
            return find(name)
        near = get_close_matches(name, names, 1)
        remedy = f"; did you mean {near[0]}?" if near else ""
        raise AttributeError(f"module {package!r} has no attribute {name!r}{remedy}", name=name)

    return get, list_names, names
