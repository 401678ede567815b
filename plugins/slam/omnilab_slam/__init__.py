"""Pose graphs, optimised by GTSAM."""

from omnilab.hooks import Register, hookimpl
from omnilab_slam.batch import GtsamBatch
from omnilab_slam.gnc import GtsamGnc
from omnilab_slam.isam2 import GtsamIsam2

__all__ = ["GtsamBatch", "GtsamGnc", "GtsamIsam2"]


@hookimpl
def register_backends(register: Register) -> None:
    register("gtsam_batch", GtsamBatch)
    register("gtsam_isam2", GtsamIsam2)
    register("gtsam_gnc", GtsamGnc)
