"""Data sets that are there already: that of a sweep or of another call, or arrays of one's own."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from affmap.env.layout import Layout
from affmap.pipeline.stage import DATA
from affmap.settings import ConfigError
from affmap.settings.messages import format_value
from affmap.store.provenance import PROVENANCE
from affmap.store.stage import read
from affmap.view import PIXELS

Arrays = dict[str, np.ndarray]


def origin(folder: Path) -> dict[str, Any]:
    """Layouts, vehicle and settings of exploration of the data set that a stage has collected.

    Raises:
        ConfigError: there is no data set.
        StoreError: its provenance is corrupted.
    """
    record = read(folder) if (folder / PROVENANCE).is_file() else {}
    if record.get("stage") != DATA.name:
        fault = "is no data set" if folder.exists() else "does not exist"
        raise ConfigError(
            f"dataset = {format_value(str(folder))} {fault}; give the folder data/<digest> of a store, such as "
            "runs/store, or arrays."
        )
    return dict(record["config"])


def own(given: Mapping[str, ArrayLike], layouts: Sequence[Layout]) -> Arrays:
    """The arrays that models are trained on, of those that `affmap.data.collect.collect` returns.

    `position` `[S, T + 1, 2]` in u, `view` `[S, T, K, 11, 11]` and `action` `[S, T, 4]`; S is a multiple of the number
    of layouts.

    Raises:
        ConfigError: one is missing, has another shape, or holds numbers that are not allowed.
    """
    if not isinstance(given, Mapping):
        raise ConfigError(
            f"dataset = {format_value(given)} is not allowed; give arrays, as in affmap.data.collect.collect, or the "
            "folder of a data set."
        )
    types = {"position": np.float32, "view": bool, "action": np.float32}
    if missing := [key for key in types if key not in given]:
        raise ConfigError(f"dataset has no {missing[0]}; give {', '.join(types)}, as in affmap.data.collect.collect.")
    try:
        arrays: Arrays = {key: np.asarray(given[key]).astype(kind) for key, kind in types.items()}
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"dataset holds no numbers ({error}); give arrays, as in affmap.data.collect.collect."
        ) from None
    sequences, steps = (*arrays["action"].shape, 0, 0)[:2]
    shapes = {
        "position": (sequences, steps + 1, 2),
        "view": (sequences, steps, len(layouts[0].channels), PIXELS, PIXELS),
        "action": (sequences, steps, 4),
    }
    for key, shape in shapes.items():
        if arrays[key].shape != shape:
            raise ConfigError(f"dataset: {key} has the shape {list(arrays[key].shape)}; it should be {list(shape)}.")
    if not sequences or not steps or sequences % len(layouts):
        raise ConfigError(
            f"dataset has {sequences} sequences of {steps} steps in {len(layouts)} layouts; give each layout as many."
        )
    if not (np.isfinite(arrays["position"]).all() and ((arrays["action"] >= 0) & (arrays["action"] <= 1)).all()):
        raise ConfigError("dataset: positions should be finite, and actions in [0, 1].")
    if not np.array_equal(np.asarray(given["view"]), arrays["view"]):  # anything else became true
        raise ConfigError("dataset: views should be true or false, or 1 or 0.")
    for layout, positions in zip(layouts, np.split(arrays["position"], len(layouts)), strict=True):
        outside = ~((positions >= 0) & (positions <= layout.size)).all(-1)
        # From inside fog, a vehicle reports positions with noise.
        if outside.any() and not any(circle.effect == "fog" for circle in layout.circles):
            raise ConfigError(
                f"dataset: position {positions[outside][0].tolist()} is outside the arena {list(layout.size)} (u) of "
                f"{layout.name!r}; give positions in u, layout by layout."
            )
    return arrays


def digest(arrays: Arrays) -> str:
    """A digest of arrays, which no configuration describes."""
    content = hashlib.sha256()
    for key, array in sorted(arrays.items()):
        content.update(f"{key} {array.dtype} {array.shape}".encode())
        content.update(np.ascontiguousarray(array).tobytes())
    return content.hexdigest()[:16]
