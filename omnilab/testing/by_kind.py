"""The trial of each kind of component."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from omnilab.api import KINDS
from omnilab.errors import ConfigError, did_you_mean
from omnilab.testing.altimeter import AltimeterTrial
from omnilab.testing.backend import BackendTrial
from omnilab.testing.descriptor import DescriptorTrial
from omnilab.testing.distance import DistanceTrial
from omnilab.testing.disturbance import DisturbanceTrial
from omnilab.testing.localizer import LocalizerTrial
from omnilab.testing.loop_closure import LoopClosureTrial
from omnilab.testing.odometry import OdometryTrial
from omnilab.testing.rules import Trial, conform
from omnilab.testing.sensor import SensorTrial
from omnilab.testing.sink import SinkTrial
from omnilab.testing.study import StudyTrial
from omnilab.testing.view_filter import trial_of as view_filter_trial

TRIALS: dict[str, Callable[..., Trial]] = {
    "sensor": SensorTrial,
    "disturbance": DisturbanceTrial,
    "descriptor": DescriptorTrial,
    "distance": DistanceTrial,
    "localizer": LocalizerTrial,
    "altimeter": AltimeterTrial,
    "odometry": OdometryTrial,
    "loop_closure": LoopClosureTrial,
    "backend": BackendTrial,
    "view_filter": view_filter_trial,
    "study": StudyTrial,
    "sink": SinkTrial,
}


def check_component(kind: str, component: Any) -> None:
    """The conformance check of a kind, such as "descriptor"."""
    if kind not in TRIALS:
        raise ConfigError(f"kind {kind!r} does not exist; there is {', '.join(KINDS)}{did_you_mean(kind, [*KINDS])}")
    conform(TRIALS[kind](component))
