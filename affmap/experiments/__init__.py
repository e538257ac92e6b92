"""Experiments and other kinds of reports, a folder each.

The paper's experiments with their claims, comparisons of one factor, searches, and the report of all experiments.

An experiment of the paper is a folder with `claims.py`; its configuration is the file of that name in
`conf/experiment`.
"""

from importlib import import_module
from pathlib import Path

from affmap.results.claims import Claim

__all__ = ["PAPER", "claims_about"]

PAPER = tuple(sorted(path.parent.name for path in Path(__file__).parent.glob("*/claims.py")))
"""The experiments of the paper, in its order."""


def claims_about(experiment: str | None) -> tuple[Claim, ...]:
    """The paper's claims about one of its experiments; none about None."""
    if experiment is None:
        return ()
    claims: tuple[Claim, ...] = import_module(f"{__name__}.{experiment}.claims").CLAIMS
    return claims
