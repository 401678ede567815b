"""YAML of calibration tools, read safely: plain values and OpenCV's matrices, of bounded size, depth and repetition."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from omnilab.errors import DataError

CORE = "tag:yaml.org,2002:"
PLAIN = {
    CORE + kind for kind in ("map", "seq", "str", "int", "float", "bool", "null", "opencv-matrix", "opencv-nd-matrix")
}
DEEPEST, MOST_ALIASES = 16, 64


def load_yaml(path: Path, text: str) -> Any:
    """The first document of a YAML text, also with OpenCV's header `%YAML:1.0`; DataError if it cannot be read."""
    import yaml

    first, _, rest = text.partition("\n")
    if first.startswith("%YAML"):  # OpenCV's is no directive of YAML
        text = "\n" + rest
    loader = _loader()
    try:
        _check_events(path, yaml.parse(text, loader))
        document = next(iter(yaml.load_all(text, loader)), None)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}" if mark else "its text"
        raise DataError(f"{path} is not YAML ({where} cannot be read); mend it, or write the file again") from None
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError):
        raise DataError(f"{path} is not YAML; mend it, or write the file again") from None
    return document


def _check_events(path: Path, events: Any) -> None:
    """DataError for what would take long or much memory, or is more than plain values."""
    import yaml

    depth = aliases = 0
    for event in events:
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        aliases += isinstance(event, yaml.AliasEvent)
        if depth > DEEPEST or aliases > MOST_ALIASES:
            raise DataError(f"{path} is nested too deeply, or repeats itself by aliases; that is no calibration")
        tag = getattr(event, "tag", None)
        if tag is not None and tag not in PLAIN:
            raise DataError(f"{path} holds the tag {tag[:60]!r}; a calibration has plain numbers, take the tag out")
        if isinstance(event, yaml.ScalarEvent) and event.value == "<<":
            raise DataError(f"{path} merges keys by <<; write them out")


@cache
def _loader() -> Any:
    """The safe loader, whose matrices are mappings with rows, cols and data, and whose keys are texts that occur once."""
    import yaml

    class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        pass

    def mapping(loader: Any, node: Any) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = str(key_node.value)
            if key in found:
                raise yaml.constructor.ConstructorError(None, None, "a key twice", key_node.start_mark)
            found[key] = loader.construct_object(value_node, deep=True)
        return found

    for kind in ("map", "opencv-matrix", "opencv-nd-matrix"):
        Loader.add_constructor(CORE + kind, mapping)
    return Loader
