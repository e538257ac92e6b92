"""Losses of a running training for Trackio (extra `[trackio]`): `trackio show` draws them."""

from contextlib import redirect_stdout, suppress
from contextvars import Context
from io import StringIO

import trackio

from affmap.training.boards import Training
from affmap.training.boards.members import MemberBoard, Run


def open_board(training: Training) -> MemberBoard:
    """Open a board with a run for each member; the experiment is the project, the training a group.

    Files are where Trackio keeps them (environment variable TRACKIO_DIR).
    """
    project = training.experiment.replace("/", "-")

    def start(name: str) -> Run:
        name = f"{training.label}, {name}"
        with suppress(ValueError):  # no project of this name yet
            for old in trackio.Api().runs(project):
                if old.name == name:
                    old.delete()
        options = {"project": project, "group": training.label, "name": name, "config": {**training.config}}
        with redirect_stdout(StringIO()):  # advice, again for each member
            # Trackio ends the run before a new one in the same context.
            run: Run = Context().run(trackio.init, **options, embed=False)
        return run

    return MemberBoard(start)
