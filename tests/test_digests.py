"""Stages of every experiment and search keep their digests, by which results in a store are found again."""

import json
from pathlib import Path

import pytest

from affmap.config.search import Search
from affmap.config.sweep import Sweep
from affmap.pipeline.job import stages

ROOT = Path(__file__).parents[1]
STORED = Path(__file__).parent / "golden" / "digests.json"
SCALES = ("full", "smoke")
HINT = "If that is meant, `python tests/test_digests.py` rewrites the list."

Jobs = dict[str, dict[str, str]]
"""Digest of each stage, by the label of the job."""


def lines() -> list[str]:
    """Command lines of all that `conf` holds."""
    conf = ROOT / "conf"
    paths = [path for group in ("experiment", "search") for path in sorted((conf / group).rglob("*.yaml"))]
    options = [path.relative_to(conf).with_suffix("").parts for path in paths]
    return [f"{group}={'/'.join(option)} scale={scale}" for group, *option in options for scale in SCALES]


def digests(line: str) -> Jobs:
    """Of a search, those of a trial with the values of the configuration."""
    arguments = line.split()
    if search := Search.read(arguments):
        configs = {"one trial": search.config}
    else:
        sweep = Sweep.read(arguments)
        configs = dict(zip(sweep.labels, sweep.configs, strict=True))
    return {label: {stage.name: stage.digest for stage in stages(config)} for label, config in configs.items()}


def stored() -> dict[str, Jobs]:
    content: dict[str, Jobs] = json.loads(STORED.read_text("utf-8"))
    return content


def write() -> None:
    """A line for each job."""
    blocks = []
    for line in lines():
        rows = [f"  {json.dumps(label)}: {json.dumps(job, sort_keys=True)}" for label, job in digests(line).items()]
        blocks.append(f" {json.dumps(line)}: {{\n" + ",\n".join(rows) + "\n }")
    STORED.write_text("{\n" + ",\n".join(blocks) + "\n}\n", encoding="utf-8")


def test_every_experiment_and_search_is_in_the_list() -> None:
    """What `conf` holds, at both scales."""
    listed, found = set(stored()), set(lines())
    assert listed == found, f"not in both: {sorted(listed ^ found)}. {HINT}"


@pytest.mark.parametrize("line", lines())
def test_stages_keep_their_digests(line: str) -> None:
    """Stored values: the stages before control are those of commit a87fe0b."""
    before, now = stored().get(line, {}), digests(line)
    assert list(now) == list(before), f"{line}: these are other jobs, or in another order. {HINT}"
    renamed = [
        f"{line}: {label}: {name} was {before[label].get(name)} and is {now[label].get(name)}"
        for label in before
        for name in sorted({*before[label], *now[label]})
        if before[label].get(name) != now[label].get(name)
    ]
    assert not renamed, "\n".join([*renamed, HINT])


if __name__ == "__main__":
    write()
