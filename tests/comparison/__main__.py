"""Compare everything a smoke run writes, byte for byte, with what another checkout writes.

`python tests/comparison OTHER [--work FOLDER] [--compare-only]`

Both checkouts need a `.venv` of their own. Results of the other one are kept in the folder and used again until its
commit changes; this one runs anew each time.
"""

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

import files
import smoke

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Run both, print each difference and a summary; the exit status is 1 where something differs."""
    arguments = parse()
    other, work = arguments.other.resolve(), arguments.work.resolve()
    before, after = work / "before", work / "after"
    commands = smoke.commands(other)
    if not arguments.compare_only:
        if not smoke.is_complete(before, other, commands):
            smoke.run(before, other, commands)
        smoke.run(after, ROOT, commands)
    for folder in (before, after):
        if not (folder / smoke.MARKER).is_file():
            sys.exit(f"{folder} is not complete; leave --compare-only out.")
    sys.exit(compare(before, after))


def parse() -> Namespace:
    """Read the command line."""
    parser = ArgumentParser("comparison", description="Compare what smoke runs of two checkouts write.")
    parser.add_argument("other", type=Path, help="checkout to compare with")
    parser.add_argument("--work", type=Path, default=ROOT / "build/comparison", help="folder of runs (%(default)s)")
    parser.add_argument("--compare-only", action="store_true", help="run nothing; compare what the last call left")
    return parser.parse_args()


def compare(before: Path, after: Path) -> int:
    """Print every difference between two folders of runs, then a summary; 1 if there are any, else 0."""
    total, equal = 0, []
    for kind in files.PATTERNS:
        names = files.find(before, kind) | files.find(after, kind)
        differences = [line for name in sorted(names) if (line := files.difference(name, before, after))]
        for line in differences:
            print(line)
        total += len(differences)
        equal.append(f"{len(names) - len(differences)} {kind}")
    print(f"{', '.join(equal)} are equal; {total or 'none'} differ.")
    return int(total > 0)


if __name__ == "__main__":
    main()
