"""All benchmarks in one run: a table on the terminal; CSV files, the machine and a figure in a folder.

`python tests/benchmarks [--output FOLDER] [--rounds N] [training] [planning] [simulation] [lookups]`
"""

import json
import sys
from argparse import ArgumentParser, Namespace
from importlib import import_module
from pathlib import Path

import figure
import machine
import pandas as pd
import torch
from measure import Result
from rich.console import Console
from tables import plain_table, table

from affmap.results import manifest
from affmap.store.files import digests
from affmap.store.provenance import PROVENANCE

EXTRAS = {
    "training": ("growth", "growth"),
    "planning": ("planning", "costs"),
    "simulation": ("simulation", "control_step"),
    "lookups": ("lookups", "maps"),
}
"""The parts of the benchmarks, modules beside this one. Each has `results`, and there is one more table to each: module
and name of the function that returns it."""


def main() -> None:
    """Measure, print and write."""
    arguments = parse()
    torch.set_num_threads(1)
    output, progress = arguments.output, Console(stderr=True)
    output.mkdir(parents=True, exist_ok=True)
    for old in [*output.glob("*.csv"), *output.glob(PROVENANCE)]:  # of an earlier run, perhaps of other parts
        old.unlink()
    (output / "machine.json").write_text(json.dumps(machine.describe(), indent=2) + "\n", encoding="utf-8")
    results: list[Result] = []
    extras: dict[str, pd.DataFrame] = {}
    for name in arguments.names:
        progress.print(f"Measuring: {name}")
        results += import_module(name).results(arguments.rounds)  # imported late: a part may need what others do not
        pd.DataFrame(results).to_csv(output / "results.csv", index=False, float_format="%.6g")
        module, function = EXTRAS[name]
        extra = extras[function] = pd.DataFrame(getattr(import_module(module), function)())
        extra.to_csv(output / f"{function}.csv", index=False, float_format="%.6g")
    console = Console(width=None if sys.stdout.isatty() else 120)
    console.print(table(results))
    for extra in extras.values():
        console.print(plain_table(extra))
    figure.write(results, extras.get("growth"), output)
    manifest.save(output, {"title": "Benchmarks"}, digests(output))
    console.print(f"Written to {output}")


def parse() -> Namespace:
    """The command line."""
    parser = ArgumentParser("benchmarks", description="Time affmap beside its peers.")
    parser.add_argument("names", nargs="*", metavar="part", help=f"{', '.join(EXTRAS)}; default: all")
    parser.add_argument("--output", type=Path, default=Path("runs/bench"), help="folder to write to (%(default)s)")
    parser.add_argument("--rounds", type=int, default=7, help="turns of each contender (%(default)s)")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(EXTRAS):
        parser.error(f"{', '.join(sorted(unknown))}: there is no such part; choose from {', '.join(EXTRAS)}.")
    arguments.names = arguments.names or list(EXTRAS)
    return arguments


if __name__ == "__main__":
    main()
