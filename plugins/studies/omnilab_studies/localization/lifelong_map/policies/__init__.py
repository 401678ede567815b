"""Policies of a map that adapts: what it takes over from a day's estimates. Each knows what a robot knows, never the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Protocol

from omnilab.api import check_settings
from omnilab.errors import ConfigError, did_you_mean
from omnilab_studies.localization.lifelong_map.appearances import Appearances, DayEstimates
from omnilab_studies.localization.lifelong_map.policies.fixed import Fixed
from omnilab_studies.localization.lifelong_map.policies.several import Several
from omnilab_studies.localization.lifelong_map.policies.update import Update


class Policy(Protocol):
    """A rule by which a map changes from one day to the next."""

    def adapt(self, known: Appearances, estimates: DayEstimates, day: int) -> Appearances:
        """The map of the next day. Every place keeps one appearance at least."""


POLICIES: Mapping[str, type[Any]] = {"fixed": Fixed, "update": Update, "several": Several}


def policy_of(name: str, settings: Mapping[str, Any]) -> Policy:
    """The policy that settings describe: `policy` is which one (None: the one of that name), the others are its own."""
    where, own = f"study.policies.{name}", dict(settings)
    kind = own.pop("policy", name)
    if kind not in POLICIES:
        raise ConfigError(
            f"{where}: there is no policy '{kind}'; give policy: {', '.join(POLICIES)}{did_you_mean(str(kind), POLICIES)}"
        )
    known = {field.name: field.default for field in fields(POLICIES[kind])}
    for setting, value in own.items():
        if setting not in known:
            raise ConfigError(
                f"{where}.{setting} is no setting of the policy {kind}, which has {', '.join(known) or 'none'}"
                f"{did_you_mean(setting, known)}"
            )
        if type(value) is not int and type(value) is not type(known[setting]):
            expected = "whole number" if isinstance(known[setting], int) else "number"
            raise ConfigError(f"{where}.{setting}={value} is no {expected}; give one, such as {known[setting]}")
    policy: Policy = POLICIES[kind](**own)
    check_settings(policy, f"{where}.")
    return policy
