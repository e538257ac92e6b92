"""Optional packages: the extras of pyproject.toml, and how to install what is missing (leaf)."""

import re
from importlib.metadata import PackageNotFoundError, requires


def requirements(extra: str) -> list[str]:
    """The requirements of an extra, as in `tensorboard>=2.15`; none where there is no such extra."""
    try:
        listed = requires("affmap") or []
    except PackageNotFoundError:  # a clone that is only on the path
        listed = []
    found = (re.fullmatch(rf"(.+?) *; *extra == .{re.escape(extra)}.", each) for each in listed)
    return [each[1] for each in found if each]


def missing(subject: str, extra: str) -> str:
    """The beginning of a sentence: what the subject needs, and a command that works in a clone and beside a wheel.

    It names the packages, and not affmap, which no registry need have.
    """
    packages = " ".join(f'"{each}"' for each in requirements(extra) or [extra])
    return f"{subject} needs a package that is not installed: pip install {packages}"
