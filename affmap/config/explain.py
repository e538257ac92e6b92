"""Errors of Hydra and OmegaConf as sentences with a remedy."""

import re
import shlex
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from hydra.errors import OverrideParseException
from omegaconf import OmegaConf

from affmap.results.provenance import leaves
from affmap.results.setting import short_name
from affmap.settings import ConfigError, folders, missing, names, read, requirements
from affmap.settings.messages import alternatives, format_value, nearest, one_line, shorten


@contextmanager
def hydra_errors() -> Iterator[None]:
    """Turn whatever Hydra raises about a command line into a ConfigError with a remedy.

    Only Hydra and checks of ours run in the block. Its parser, its YAML and its interpolations let Python's own errors
    through: ValueError for a step of 0, RecursionError for brackets in brackets, AttributeError for a group that is
    null.
    """
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(_explain(error)) from None


def _explain(error: Exception) -> str:
    """Hydra's error as a sentence: a malformed override, an unknown key, an unknown option, or anything else."""
    text = str(error) or str(error.__cause__ or "") or "Hydra gives no reason"
    if isinstance(error, RecursionError):
        return "this cannot be read: it is nested too deeply."
    if isinstance(error, OverrideParseException):
        reason = re.search(r"while (evaluating .*)", text)
        remedy = one_line(reason[1]) if reason else _explain_override(error.override)
        return f"the override {format_value(error.override)} cannot be read: {remedy}."
    if override := re.search(r"^Could not override '(.+)'\.\nTo append to your config", text):
        node = getattr(error.__cause__, "parent_node", None)
        return _explain_key(getattr(error.__cause__, "full_key", None) or override[1], node)
    if unknown := re.search(
        r"^Could not override '(.+?)'\.\s+(?:No match|Did you)|^.+ config\. '(.+)' does not exist", text
    ):
        return _explain_key(unknown[1] or unknown[2])
    if other := re.search(r"^Could not delete '(.+?)=(.*)'\. No match|value of '(.+)' is .* and not (.*)\.$", text):
        key, value = other[1] or other[3], other[2] or other[4]
        return f"{one_line(key)} is not {one_line(value)}, so it cannot be removed; leave the override out."
    if plugin := re.search(r"Could not find '(hydra/\w+)/(\w+)'|In '(hydra/\w+)/(\w+)': Could not load", text):
        group, name = plugin[1] or plugin[3], plugin[2] or plugin[4]
        if requirements(name):
            return f"{missing(f'{group} = {name!r}', name)}."
    if choice := re.search(r"Could not find '(.*)'\n+Available options in '([\w/]+)':((?:\n\t.*)*)", text):
        path, group, listed = choice.groups()
        name = path.removeprefix(f"{group}/")
        every = [*listed.split(), *_nested(group)]  # files of Hydra's own groups, too
        meant = next((each for each in every if short_name(each).lower() == name.lower()), name)  # as in reports
        return f"{group} = {format_value(name)} does not exist; {alternatives(meant, every)}"
    if present := re.search(r"An item is already at '(.+?)'", text):
        return f"{one_line(present[1])} is a key already; leave out the +."
    if twice := re.search(r'found duplicate key (.+)\n *in "(.+)", line (\d+)', text):
        key, path, line = twice.groups()
        return f"{_shorten(path)}, line {line}: the key {format_value(key)} stands twice; keep one of the two."
    # Hydra's messages end in addresses, its own places and types, and name classes and columns.
    text = re.split(r"\n\s*(?:See http|Config search path|full_key|reference_type|To append|\^)", text)[0]
    text = re.sub(r"^\w+Exception: |\w+(?:Error|Exception) (?:raised )?(?=while )", "", text)
    return f"this cannot be read: {one_line(_shorten(text)).rstrip('.')}."


def _shorten(text: str) -> str:
    """A text with `conf` in place of the path of that folder."""
    for each in folders():
        text = text.replace(str(each), "conf")
    return text


def _explain_override(override: str) -> str:
    """The character that Hydra's grammar cannot place, and the remedy."""
    key, equals, value = override.partition("=")
    if not equals or not re.fullmatch(r"[~+]{0,2}[\w.$/@-]+", key, re.ASCII):
        return "write key=value, such as model.context_size=3"
    if hidden := [c for c in value if not c.isprintable()]:
        return f"{hidden[0]!r} does not print; leave it out"
    if value.startswith("~"):
        return "a shell knows ~ at the beginning of a word only; write $HOME instead"
    strange = re.search(r"[^\w/\\+.$%*@?|: \[\](){},=-]", value, re.ASCII)
    if strange and strange[0] not in "'\"":
        quoted = shlex.quote(f'{key}="{value}"')
        example = "" if re.search(r"[\\\[\](){},='\"]", value) else f", as in {shorten(quoted, 200)}"
        return f"text with {strange[0]} needs quotes{example}"
    return "brackets, quotes, commas and = have a meaning of their own; complete it, or put quotes around text"


def _explain_key(key: str, node: Any = None) -> str:
    """A key that the configuration does not have, as a sentence; capitals are those of make's variables.

    `node` is the part of the configuration in which Hydra did not find it.
    """
    key = one_line(key)
    if key.isupper():
        return (
            f"{key} is a variable of make, as in make exp1 {key}=...; affmap takes overrides such as scale=smoke, "
            "models=reference or hydra.launcher.n_jobs=1 instead."
        )
    if re.split(r"[./]", key)[0] == "layout":
        return f"{key} is not a known key; {_choose_layout()}"
    if options := _options_with(key):
        return (
            f"{key} is a key of {' and '.join(options)} only, and not every job here has that; say {options[0]}, or "
            "leave the key out."
        )
    near = _nearest_key(key, node)
    return f"{key} is not a known key; {f'did you mean {near}?' if near else 'correct its spelling.'}"


def _choose_layout() -> str:
    """The keys that name a file of `conf/layout`, which is no group: `world` and those that follow it."""
    name = names("layout")[0]
    follow = {"${world}": f"={name}", "['${world}']": f"=[{name}]"}
    *keys, last = [f"{key}{follow[str(value)]}" for key, value in read(".", "config").items() if str(value) in follow]
    return f"choose a layout by world={name}, for all that names no other, or by {', '.join(keys)} or {last}."


def _nearest_key(key: str, node: Any) -> str | None:
    """The key of the same part of the configuration that `key` most likely means; else a key anywhere."""
    if not OmegaConf.is_dict(node):
        return None
    place, dot, name = key.rpartition(".")
    tree: Any = OmegaConf.to_container(node)
    every = {each.rpartition(".")[2]: each for each in leaves(tree) if "_logging." not in each}
    if key in every:
        return every[key]
    beside = [] if place else groups()  # some, such as experiment, are no keys
    if near := nearest(name, [*map(str, node), *beside]):
        return f"{place}{dot}{near}"
    near = None if place else nearest(key, every)
    return every[near] if near else None


def _options_with(key: str) -> list[str]:
    """Options of a key's group whose files have it, as in `planner=cem`."""
    place, _, name = key.rpartition(".")
    group = place.replace(".", "/")
    options = []
    for option in names(group) if re.fullmatch(r"\w+(/\w+)*", group) else ():
        with suppress(ConfigError):  # of a file with another mistake
            options += [f"{group}={option}"] if name in read(group, option) else []
    return options


def _nested(group: str) -> list[str]:
    """Options of a group that Hydra's list leaves out: files in its folders, but for those that are groups."""
    known = groups()
    paths = [path.relative_to(each) for each in folders() for path in sorted(each.glob(f"{group}/*/**/*.yaml"))]
    return [str(path.relative_to(group).with_suffix("")) for path in paths if path.parent.as_posix() not in known]


def groups() -> list[str]:
    """The groups of which a configuration chooses files, in the order of its defaults."""
    entries = [entry for entry in read(".", "config")["defaults"] if isinstance(entry, dict)]
    return [key.removeprefix("override ") for entry in entries for key in entry]


def options(group: str) -> list[str]:
    """The files of a group of `conf`, as an override names them."""
    return [*names(group), *_nested(group)]
