"""Experiments and other kinds of reports, a folder each.

The folder of an experiment, its room, is named after its file in `conf/experiment`, and its contents are found there:

| file | what it is |
|---|---|
| `claims.py` | `CLAIMS`, sentences that are tested; those of the paper's experiments are in the paper's report |
| `page.md` | the page of its report; without one, `affmap/report/page.md` |
| `introduction.md`, `expected.md` | question and predictions, in its report and in that of all beyond the paper |
| `*.md` | other texts that the page includes |
| `figures/<name>.py` | figures of its own: `draw(results, settings)`, as in `affmap/report/figures` |
"""

from importlib import import_module
from pathlib import Path

from affmap.report.experiment import PARTS, Room
from affmap.results.claims import Claim
from affmap.settings import ConfigError
from affmap.settings.base import read

__all__ = ["ROOMS", "by_number", "claims_about", "is_of_paper", "open_room"]

_HERE = Path(__file__).parent


def by_number(name: str) -> tuple[int, str]:
    """The key by which names of experiments are sorted: the tenth comes after the ninth."""
    return len(name.partition("_")[0]), name


ROOMS = tuple(sorted((path.parent.name for path in _HERE.glob("*/claims.py")), key=by_number))
"""The rooms that have claims."""


def is_of_paper(experiment: str) -> bool:
    """Whether an experiment is one of the paper's, whose figures its report names."""
    return "paper_figures" in read("experiment", experiment)["report"]


def claims_about(experiment: str | None) -> tuple[Claim, ...]:
    """Claims about an experiment; empty for None."""
    if experiment is None:
        return ()
    module = import_module(f"{__name__}.{experiment}.claims")
    claims: tuple[Claim, ...] | None = getattr(module, "CLAIMS", None)
    if claims is None:
        raise ConfigError(f"{module.__file__} should have CLAIMS, a tuple of affmap.results.claims.Claim.")
    return claims


def open_room(experiment: str, claims: str | None) -> Room:
    """Collect an experiment's claims, texts and figures for its report.

    Args:
        experiment: its name; it may have no folder.
        claims: the experiment whose claims are tested, or None. An experiment that has claims is another one without
            them, such as one in a world of the user's own; its report has the general page and no predictions.
    """
    folder, default = _HERE / experiment, Room()
    if not folder.is_dir() or (claims is None and experiment in ROOMS):
        return Room(claims_about(claims))
    page = folder / "page.md"
    own = [f"{__name__}.{experiment.replace('/', '.')}.figures"] if (folder / "figures").is_dir() else []
    return Room(
        claims_about(claims),
        page if page.is_file() else default.page,
        (folder, PARTS),
        [*default.figures, *own],
    )
