"""Plain YAML, in which a key stands once and aliases stand for little."""

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from affmap.settings.messages import ConfigError, format_value, one_line

MOST_ALIASED = 10_000
"""Most values that the aliases of a file may stand for. Aliases of aliases multiply: 300 bytes can mean 10^9 values."""

MOST_BYTES = 10**6
"""Most bytes of a file, which take seconds to read; the largest layout that is allowed has a tenth of them."""

_MERGE = "tag:yaml.org,2002:merge"


def check_size(path: Path, name: str) -> None:
    """Make sure that a file can be read in little time.

    Raises:
        ConfigError: it is too large.
    """
    if (size := path.stat().st_size) > MOST_BYTES:
        raise ConfigError(f"{name} has {size:,} bytes; a file of conf may have {MOST_BYTES:,}, so make it shorter.")


def load(text: str, name: str) -> Any:
    """The content of a file.

    Raises:
        ConfigError: it is not plain YAML, a key stands twice, or aliases stand for too much; the message says where.
    """
    try:
        loader = yaml.SafeLoader(text)
        root = loader.get_single_node()
        if root is None:
            return None
        for node in _check_sizes(root, name):
            _check_keys(node, name)
        return loader.construct_document(root)
    except ConfigError:
        raise
    except Exception as error:  # Python's own, too: ValueError for a month 13, RecursionError for brackets in brackets
        raise ConfigError(f"{name} is not plain YAML: {one_line(_reason(error, text))}.") from None


def _reason(error: Exception, text: str) -> str:
    """An error as text: the line of the file and what is wrong there, as far as they are known."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, yaml.reader.ReaderError):
        line = text.count("\n", 0, error.position) + 1
        return f"line {line}: the character {chr(error.character)!r} is not allowed"
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark:
        reason = ", ".join(filter(None, (error.context, error.problem)))
        return f"line {error.problem_mark.line + 1}: {reason}"
    return str(error)


def check_aliases(text: str, name: str) -> None:
    """Make sure that the aliases of a file, which may be no YAML at all, do not stand for too much.

    Raises:
        ConfigError: they do.
    """
    if "*" in text and "&" in text:  # else it has none
        with suppress(yaml.YAMLError, RecursionError):
            if root := yaml.compose(text, Loader=yaml.SafeLoader):
                _check_sizes(root, name)


def _check_sizes(root: yaml.Node, name: str) -> list[yaml.Node]:
    """All nodes below `root`, once each, if their aliases stand for little."""
    sizes: dict[yaml.Node, float] = {}
    if _size(root, sizes) - len(sizes) > MOST_ALIASED:
        raise ConfigError(f"{name} has aliases that stand for more than {MOST_ALIASED} values; write out fewer values.")
    return [*sizes]


def _size(node: yaml.Node, sizes: dict[yaml.Node, float]) -> float:
    """Number of values in a node, with those that aliases stand for; infinite where one stands in itself."""
    if node not in sizes:
        sizes[node] = math.inf
        parts = node.value if isinstance(node, yaml.SequenceNode) else []
        if isinstance(node, yaml.MappingNode):
            parts = [part for pair in node.value for part in pair]
        sizes[node] = 1 + sum(_size(part, sizes) for part in parts)
    return sizes[node]


def _check_keys(node: yaml.Node, name: str) -> None:
    """Make sure that no key of a mapping stands twice; what a key merges (`<<`) may be overridden."""
    if not isinstance(node, yaml.MappingNode):
        return
    known = set()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode) and key.tag != _MERGE:
            if key.value in known:
                line = key.start_mark.line + 1
                raise ConfigError(
                    f"{name}, line {line}: the key {format_value(key.value)} stands twice; keep one of the two."
                )
            known.add(key.value)
