"""Back ends for pose graphs (GTSAM) and filters for view-based SLAM."""

from omnilab.hooks import Register, hookimpl
from omnilab_slam.batch import GtsamBatch
from omnilab_slam.fast_slam import FastSlam
from omnilab_slam.fast_slam2 import FastSlam2
from omnilab_slam.gnc import GtsamGnc
from omnilab_slam.isam2 import GtsamIsam2
from omnilab_slam.landmark_ekf import LandmarkEkf
from omnilab_slam.view_ekf import ViewEkf
from omnilab_slam.view_graph import ViewGraph

__all__ = ["FastSlam", "FastSlam2", "GtsamBatch", "GtsamGnc", "GtsamIsam2", "LandmarkEkf", "ViewEkf", "ViewGraph"]


@hookimpl
def register_backends(register: Register) -> None:
    register("gtsam_batch", GtsamBatch)
    register("gtsam_isam2", GtsamIsam2)
    register("gtsam_gnc", GtsamGnc)


@hookimpl
def register_view_filters(register: Register) -> None:
    register("view_ekf", ViewEkf)
    register("view_graph", ViewGraph)
    register("landmark_ekf", LandmarkEkf)
    register("fast_slam", FastSlam)
    register("fast_slam2", FastSlam2)
