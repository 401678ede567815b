"""Conformance checks for plugin authors: one call in a test, and a component is known to keep the contract.

::

    from omnilab.testing import check_descriptor

    def test_mine():
        check_descriptor(Mine())

Each check takes the component alone; what more it takes (images, a layout, parts) replaces what it is shown otherwise.
"""

from typing import Any

from omnilab import renamed
from omnilab.testing.altimeter import check_altimeter
from omnilab.testing.backend import check_backend
from omnilab.testing.by_kind import check_component
from omnilab.testing.descriptor import check_descriptor
from omnilab.testing.distance import check_distance
from omnilab.testing.disturbance import check_disturbance
from omnilab.testing.localizer import check_embedder, check_localizer
from omnilab.testing.loop_closure import check_loop_closure
from omnilab.testing.odometry import check_odometry
from omnilab.testing.parts import study_parts
from omnilab.testing.sensor import check_sensor
from omnilab.testing.sink import check_sink, sample_records
from omnilab.testing.study import check_study
from omnilab.testing.view_filter import check_view_filter

__all__ = [
    "check_altimeter",
    "check_backend",
    "check_component",
    "check_descriptor",
    "check_distance",
    "check_disturbance",
    "check_embedder",
    "check_localizer",
    "check_loop_closure",
    "check_odometry",
    "check_sensor",
    "check_sink",
    "check_study",
    "check_view_filter",
    "sample_records",
    "study_parts",
]


def __getattr__(name: str) -> Any:
    """Names of the version before."""
    return renamed.attribute(__name__, name, renamed.TESTING)
