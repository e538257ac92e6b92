"""Modules from outside of the package, which add planners, transition models, agents, terrains and metrics.

Users name them: packages that they installed, in their entry points of the group `affmap`; and they themselves, in the
environment variable AFFMAP_IMPORT, for modules of the current folder. Workers of every launcher inherit the variable. A
configuration or a stored file names kinds only, never a module.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import Distribution, distribution, entry_points, packages_distributions
from pathlib import Path
from traceback import extract_tb
from typing import Any

from affmap.settings.messages import VARIABLE, ConfigError, alternatives, format_value, one_line

GROUP = "affmap"
"""Group of entry points; the value of each is a module."""

_outside: dict[tuple[str, str], str] = {}
"""Place in a configuration, and a name there -> the module from outside that registered it."""


def load() -> None:
    """Import the modules that users name, once.

    Raises:
        ConfigError: one of them cannot be imported; the message names it, its line and the error.
    """
    _load(os.environ.get(VARIABLE, ""))


@cache
def _load(names: str) -> None:
    for entry in entry_points(group=GROUP):
        _import(
            entry.module, f"the entry point {entry.name!r} of {_title(entry.dist)}", "mend or uninstall the package"
        )
    if names:
        _look_here()
    origin, remedy = f"{VARIABLE} = {format_value(names)}", f"correct the name or the module, or unset {VARIABLE}"
    for name in filter(None, map(str.strip, names.split(","))):
        _import(name, origin, remedy)
        _check_own(name, origin, f"also in {VARIABLE}")


def make(place: str) -> Any:
    """Call a function or a class of a module, `module:name`, which may lie in the current folder, without arguments.

    Raises:
        ConfigError: there is no such module or name, or it cannot be imported or called.
    """
    module, _, name = place.partition(":")
    if not re.fullmatch(r"\w+(\.\w+)*:\w+", place):
        raise ConfigError(f"{format_value(place)} names no function; write module:function, such as mine:agent.")
    _look_here()
    _import(module, place, "correct the name or the module")
    _check_own(module, place, "and its name here")
    there = vars(sys.modules[module])
    if not callable(there.get(name)):
        own = [key for key, value in there.items() if callable(value) and getattr(value, "__module__", "") == module]
        remedy = alternatives(name, own) if own else "define one."
        raise ConfigError(f"{place}: {module!r} has no function or class {name!r}; {remedy}")
    with blamed(place, f"calling {name}"):
        return there[name]()


@contextmanager
def blamed(place: str, work: str) -> Iterator[None]:
    """Turn an error in a block that runs code of users into a sentence.

    Args:
        place: of the code, `module:name`.
        work: that the block does.

    Raises:
        ConfigError: anything that the block raises; the message names the last line of the module that took part.
    """
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:
        source = _source(place.partition(":")[0])
        lines = [frame for frame in extract_tb(error.__traceback__) if source and Path(frame.filename) == source]
        where = f" in {lines[-1].filename}, line {lines[-1].lineno}," if lines else ""
        raise ConfigError(f"{place}: {work} failed{where} with {_reason(error)}; correct the module.") from error


def _look_here() -> None:
    """Let imports find modules of the current folder."""
    sys.path += [folder for folder in (str(Path.cwd()),) if folder not in sys.path]  # last, so it hides nothing


def _check_own(module: str, origin: str, rename: str) -> None:
    """Make sure that a module of the current folder is the one that was imported under its name."""
    place, found = Path.cwd().joinpath(*module.split(".")), _source(module)
    own = [path for path in (place / "__init__.py", place.with_suffix(".py")) if path.is_file()]
    if own and not (found and any(path.samefile(found) for path in own)):
        raise ConfigError(
            f"{origin}: Python has another module {module!r}, {found or 'built in'}, which hides {own[0]}; "
            f"rename your module, {rename}."
        )


def _import(module: str, origin: str, remedy: str) -> None:
    try:
        import_module(module)
    except Exception as error:
        place, reason = _place(error), _reason(error)
        raise ConfigError(f"{origin}: importing {module!r} failed{place} with {reason}; {remedy}.") from error


def _reason(error: Exception) -> str:
    return one_line(f"{type(error).__name__}: {error}", 300).rstrip(".")


def _place(error: Exception) -> str:
    """The line at which an import failed, in the file of the module or, of a package, in any; empty if it has none."""
    _, _, *frames = extract_tb(error.__traceback__)  # without those of this file and of `import_module`
    frames = [frame for frame in frames if not frame.filename.startswith("<frozen")]
    if not frames:
        return ""
    file = Path(frames[0].filename)
    own = file.parent if file.name == "__init__.py" else file
    *_, last = (frame for frame in frames if Path(frame.filename).is_relative_to(own))
    return f" in {last.filename}, line {last.lineno},"


def _title(found: Distribution | None) -> str:
    return f"{found.name} {found.version}" if found else "a package"


def note(place: str, name: str, module: str) -> None:
    """Note where a name comes from, if that is outside of this package.

    Args:
        place: the key of a configuration that takes the name, such as `planner.kind`.
        name: that was registered.
        module: that registered it.

    Raises:
        ValueError: another module from outside has registered it.
    """
    if module.partition(".")[0] == __name__.partition(".")[0]:
        return
    if (other := _outside.setdefault((place, name), module)) != module:
        raise ValueError(f"{name!r} of {module} is registered by {other} already; give it another name.")


def origins(config: Mapping[str, Any]) -> list[dict[str, str]]:
    """The origins of everything in a plain configuration that comes from outside, for provenance.

    Returns:
        For each its `name`, such as `planner.kind=mine`, its `module`, the `sha256` of that one's file, and the
        `distribution` with its `version` where the module is installed.
    """
    leaves = [*_leaves(config)] if _outside else []
    return [
        {"name": f"{place}={name}", **origin(module)}
        for (place, name), module in sorted(_outside.items())
        if any(f".{key}".endswith(f".{place}") and value == name for key, value in leaves)
    ]


def origin(module: str) -> dict[str, str]:
    """The origin of a module that was imported: its name, the `sha256` of its file, and its installed distribution."""
    path, found = _source(module), _distribution(module.partition(".")[0])
    return {
        "module": module,
        **({"sha256": hashlib.sha256(path.read_bytes()).hexdigest()} if path else {}),
        **({"distribution": found.name, "version": found.version} if found else {}),
    }


def own_files(module: str) -> list[Path]:
    """The file of a module that lies in the current folder; none for a package, or a module from elsewhere."""
    path = Path.cwd() / f"{module}.py"
    return [path] if path.is_file() else []


def sources() -> list[Path]:
    """Files of the modules from outside that have registered something."""
    return [path for module in sorted({*_outside.values()}) if (path := _source(module))]


def _source(module: str) -> Path | None:
    """The file of a module; None in a notebook."""
    file = getattr(sys.modules.get(module), "__file__", None)
    return Path(file) if file and Path(file).is_file() else None


@cache
def _distribution(package: str) -> Distribution | None:
    """The installed distribution of a package; an editable one lists no files, but has entry points."""
    entries = (entry for entry in entry_points(group=GROUP) if entry.module.partition(".")[0] == package)
    if entry := next(entries, None):
        return entry.dist
    return next((distribution(name) for name in packages_distributions().get(package, ())), None)


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key, without the places in lists, and value, of all leaves of a plain configuration."""
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _leaves(part, f"{key}.{name}")
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _leaves(part, key)
    else:
        yield key, value
