"""A plugin that says for which version of the contract it was written."""

from __future__ import annotations

import re
from types import ModuleType

from omnilab import __version__
from omnilab.api import KINDS
from omnilab.api.contract import CHANGES, CONTRACT_VERSION
from omnilab.errors import PluginError

NAME = "CONTRACT"


def news_for(plugin: ModuleType) -> str:
    """What has changed of the kinds that a plugin registers since it was written, as a sentence; "" if nothing has.

    PluginError for one of a newer contract, which may need what is not here.
    """
    if (written := getattr(plugin, NAME, None)) is None:
        return ""
    if not isinstance(written, str) or not re.fullmatch(r"\d{1,9}\.\d{1,9}", written):
        raise PluginError(f'{NAME} = {written!r} is no version of the contract; write {NAME} = "{CONTRACT_VERSION}"')
    if _numbers(written) > _numbers(CONTRACT_VERSION):
        raise PluginError(
            f"it was written for contract {written}, and omnilab {__version__} has {CONTRACT_VERSION}; install a newer"
            " omnilab: pip install --upgrade omnilab"
        )
    kinds = {"", *(kind.name for kind in KINDS.values() if hasattr(plugin, kind.hook))}
    news = [each for each in CHANGES if each.kind in kinds and _numbers(each.version) > _numbers(written)]
    if kinds == {""} or not news:
        return ""
    words = "; ".join(f"{each.kind}: {each.what}" if each.kind else each.what for each in news)
    return (
        f"it was written for contract {written}, since when {words}; see to that, and write"
        f' {NAME} = "{CONTRACT_VERSION}"'
    )


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))
