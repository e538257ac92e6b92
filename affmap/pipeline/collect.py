"""The stage `data`: exploration of the training layouts."""

import logging

from affmap.config.root import Config
from affmap.data.collect import collect, coverage, write_dataset
from affmap.pipeline.progress import track
from affmap.results.files import write_coverage
from affmap.store.attempt import Attempt

log = logging.getLogger("affmap")


def make_data(config: Config, attempt: Attempt) -> None:
    """Explore, and write the data set and its coverage."""
    layouts, num_sequences = config.training_layouts, config.data.num_sequences
    names = ", ".join(layout.name for layout in layouts)
    with track(f"exploration of {names}", len(layouts) * num_sequences, "sequences", attempt.progress) as update:
        arrays = collect(layouts, config.vehicle, config.data, lambda sequence: update(sequence + 1))
    write_dataset(attempt.folder, arrays)
    parts = arrays["true_position"].reshape(len(layouts), num_sequences, -1, 2)
    coverages = [coverage(layout, config.vehicle, part) for layout, part in zip(layouts, parts, strict=True)]
    share = 100 * write_coverage(attempt.folder, coverages).coverage.min()
    log.info("exploration of %s: at least %.1f %% of the free squares visited", names, share)
