"""The stage `map`: affordance maps of the members, for reports."""

from pathlib import Path

import numpy as np

from affmap.config.root import Config
from affmap.model.lookup import AffordanceMap
from affmap.model.stack import Stack
from affmap.model.weights import SNAPSHOT, restore
from affmap.pipeline.train import trained, untrained
from affmap.results.files import Maps, write_maps
from affmap.store.attempt import Attempt


def make_maps(config: Config, train: Path, attempt: Attempt) -> None:
    """Paint and write the maps of all members: trained, untrained, and at snapshots of the weights."""
    snapshots = sorted(train.glob(SNAPSHOT.format(epoch="*"))) if config.report.snapshots else []
    codes = _codes(config, trained(config, train))
    _, rows, columns, _ = codes.shape
    width, height = config.map_layout.size
    maps = Maps(
        codes=codes,
        initial_codes=_codes(config, untrained(config)),
        snapshot_codes=np.array([_codes(config, restore(untrained(config), path)) for path in snapshots]),
        epochs=np.array([int(path.stem.rpartition("-")[2]) for path in snapshots], int),
        x=np.linspace(0, width, columns),
        y=np.linspace(0, height, rows),
        member=np.array(config.seeds),
    )
    write_maps(attempt.folder, maps)


def _codes(config: Config, stack: Stack) -> np.ndarray:
    """The codes of all members at the nodes of the map's layout, `[M, Y, X, C]`."""
    return AffordanceMap.paint(stack, [config.map_layout.map], config.report.map_spacing).codes.numpy()
