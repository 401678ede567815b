"""All families of cases, by name."""

from __future__ import annotations

import torture_cases
import torture_surroundings
from torture_cases import Case

FAMILIES: dict[str, Case] = {
    "kill": torture_cases.kill,
    "instant": torture_cases.instant,
    "signal": torture_cases.heard,
    "full": torture_cases.full,
    "cache": torture_cases.cacheless,
    "limit": torture_cases.limited,
    "pipe": torture_cases.pipes,
    "disk": torture_surroundings.disk,
    "pids": torture_surroundings.pids,
    "together": torture_surroundings.together,
    "identity": torture_surroundings.identity,
}
