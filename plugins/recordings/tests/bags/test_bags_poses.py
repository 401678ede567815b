"""Poses of the camera of a log: by the tree of frames or by a topic, on whichever axes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from omnilab.api import RecordedPoses
from omnilab.errors import ConfigError, DataError
from omnilab_recordings import RosBag
from omnilab_recordings.bags.camera_poses import Axes

BEGIN_NS = 1_700_000_000_000_000_000
TENTH = 10**8
SPHERE = {"panorama": "equirectangular"}
OPTICAL = Rotation.from_quat([-0.5, 0.5, -0.5, 0.5])  # of a camera that looks ahead, in its body (REP 103)


def images(maker, pictures, frame: str) -> list:
    at = [BEGIN_NS + i * TENTH for i in range(len(pictures))]
    return [("/cam/image_raw", t, maker.image(p, t, frame=frame)) for t, p in zip(at, pictures, strict=True)]


def drive(count: int = 30, begin_ns: int = BEGIN_NS - TENTH, step_ns: int = 40_000_000):
    """A robot's times, positions and rotations."""
    rng = np.random.default_rng(9)
    times = begin_ns + np.arange(count) * step_ns
    return (
        times,
        np.cumsum(rng.normal(0, 0.2, (count, 3)), 0),
        Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.2, (count, 3)), 0)),
    )


def planned(bag, **settings):
    sensor = RosBag(str(bag), **SPHERE, **settings)
    plan = sensor.plan(RecordedPoses())
    rows = [int(key.rpartition("#")[2]) for key in plan.keys]
    return sensor, plan.T_world_camera, BEGIN_NS + np.array(rows) * TENTH


def test_a_chain_of_moving_and_fixed_frames(ros, pictures) -> None:
    """map > odom > base > mast > optical frame, composed by hand with scipy's rotations."""
    maker, write = ros
    times, position, R = drive()
    slow, drift, R_drift = drive(8, BEGIN_NS - 2 * TENTH, 2 * TENTH)
    R_mast = Rotation.from_euler("z", 30, degrees=True)
    still = [
        maker.transform("base", "mast", [0.1, 0, 0.5], R_mast.as_quat(), 0),
        maker.transform("mast", "cam_optical_frame", [0, 0, 0.2], OPTICAL.as_quat(), 0),
    ]
    messages = [("/tf_static", BEGIN_NS - 3 * TENTH, maker.tf(*still))]
    messages += [
        ("/tf", t, maker.tf(maker.transform("odom", "base", p, r.as_quat(), t)))
        for t, p, r in zip(times.tolist(), position, R, strict=True)
    ]
    messages += [
        ("/tf", t, maker.tf(maker.transform("map", "odom", p, r.as_quat(), t)))
        for t, p, r in zip(slow.tolist(), drift, R_drift, strict=True)
    ]
    bag = write(messages + images(maker, pictures, "cam_optical_frame"))
    sensor, T, at = planned(bag)
    assert len(T) == 8
    assert sensor.stream.remarks["poses of"] == "poses are those of map > odom > base > mast > cam_optical_frame"
    mast, up = np.eye(4), np.eye(4)
    mast[:3, :3], mast[:3, 3], up[2, 3] = R_mast.as_matrix(), [0.1, 0, 0.5], 0.2
    # of a camera that looks ahead, the frame of omnilab is that of the body
    expected = at_times(at, times, position, R) @ mast @ up
    exact = np.isin(at, times)
    assert exact.sum() >= 4
    _, in_odom, _ = planned(bag, world="odom")
    assert in_odom == pytest.approx(expected, abs=2e-2)  # between composed poses, 40 ms apart
    assert in_odom[exact] == pytest.approx(expected[exact], abs=1e-9)
    assert T[exact] == pytest.approx((at_times(at, slow, drift, R_drift) @ expected)[exact], abs=1e-9)


def at_times(at, times, position, R) -> np.ndarray:
    """Poses between others, by scipy."""
    T, t = np.tile(np.eye(4), (len(at), 1, 1)), (times - times[0]) / 1e9
    T[:, :3, :3] = Slerp(t, R)((at - times[0]) / 1e9).as_matrix()
    T[:, :3, 3] = np.stack([np.interp((at - times[0]) / 1e9, t, p) for p in position.T], 1)
    return T


def test_axes_and_looks_turn_the_poses(ros, pictures) -> None:
    maker, write = ros
    times, position, R = drive()
    tf = [
        ("/tf", t, maker.tf(maker.transform("world", "cam", p, r.as_quat(), t)))
        for t, p, r in zip(times.tolist(), position, R, strict=True)
    ]
    bag = write(tf + images(maker, pictures, "cam"))
    _, body, _ = planned(bag)
    sensor, optical, _ = planned(bag, axes=Axes.optical)
    assert "x right, y down, z ahead, which here is ahead; else give sensor.axes=body" in sensor.stream.remarks["axes"]
    ahead = optical[:, :3, 0]
    assert ahead == pytest.approx(body[:, :3, 2])  # z ahead becomes omnilab's x
    assert optical[:, :3, 2] == pytest.approx(-body[:, :3, 1])  # y down becomes -z
    _, down, _ = planned(bag, axes=Axes.optical, looks="down")
    assert down[:, :3, 2] == pytest.approx(-body[:, :3, 2])
    _, up, _ = planned(bag, axes=Axes.optical, looks="up")
    assert up[:, :3, 2] == pytest.approx(body[:, :3, 2])
    for T in (body, optical, down, up):
        assert np.linalg.det(T[:, :3, :3]) == pytest.approx(1)


def test_a_topic_of_odometry(ros, pictures) -> None:
    maker, write = ros
    times, position, R = drive()
    odometry = [
        ("/odom", t, maker.odometry(p, r.as_quat(), t)) for t, p, r in zip(times.tolist(), position, R, strict=True)
    ]
    bag = write(odometry + images(maker, pictures, "cam"))
    sensor, T, _ = planned(bag)
    assert T is None
    assert (
        "no transform leads to their frame 'cam'; give sensor.poses=TOPIC, one of /odom"
        in sensor.stream.remarks["poses"]
    )
    sensor, T, at = planned(bag, poses="/odom")
    assert T[:, :3, 3] == pytest.approx(
        np.stack([np.interp(at - times[0], times - times[0], p) for p in position.T], 1), abs=1e-9
    )
    assert "the camera is taken to be there" in sensor.stream.remarks["poses of"]
    mounted = [("/tf_static", BEGIN_NS, maker.tf(maker.transform("base", "cam", [0, 0, 1], [0, 0, 0, 1], 0)))]
    sensor, raised, _ = planned(write(mounted + odometry + images(maker, pictures, "cam"), "mounted"), poses="/odom")
    exact = np.isin(at, times)
    assert raised[exact, :3, 3] == pytest.approx((T[:, :3, 3] + T[:, :3, 2])[exact], abs=1e-9)
    assert "odom to base, and from there to the camera's frame cam" in sensor.stream.remarks["poses of"]


def test_what_is_wrong_with_poses_is_said(ros, pictures) -> None:
    maker, write = ros
    bag = write(images(maker, pictures, "cam"))
    with pytest.raises(ConfigError, match=r"/odom is no topic of poses in .*; it has none of nav_msgs/Odometry"):
        planned(bag, poses="/odom")
    with pytest.raises(ConfigError, match=r"world=map, but .* has no transform to the frame of the images, 'cam'"):
        planned(bag, world="map")
    bad = [("/tf", BEGIN_NS, maker.tf(maker.transform("map", "cam", [0, 0, 0], [0, 0, 0, 0], BEGIN_NS)))]
    with pytest.raises(DataError, match="map to cam has poses that are none"):
        planned(write(bad + images(maker, pictures, "cam"), "zero"))
    circle = maker.tf(
        maker.transform("a", "cam", [0, 0, 0], [0, 0, 0, 1], 0), maker.transform("cam", "a", [0, 0, 0], [0, 0, 0, 1], 0)
    )
    with pytest.raises(DataError, match="hang from each other in a circle"):
        planned(write([("/tf", BEGIN_NS, circle), *images(maker, pictures, "cam")], "circle"))
    two = maker.tf(
        maker.transform("a", "cam", [0, 0, 0], [0, 0, 0, 1], 0), maker.transform("b", "cam", [0, 0, 0], [0, 0, 0, 1], 0)
    )
    with pytest.raises(DataError, match="the frame cam hang from a and from b"):
        planned(write([("/tf", BEGIN_NS, two), *images(maker, pictures, "cam")], "two"))
    still = maker.tf(maker.transform("a", "cam", [0, 0, 0], [0, 0, 0, 1], 0))
    sensor, T, _ = planned(write([("/tf", BEGIN_NS, still), *images(maker, pictures, "cam")], "still"))
    assert T is None
    assert "nothing moves from a to cam" in sensor.stream.remarks["poses"]


def test_poses_of_another_clock_by_years(ros, pictures) -> None:
    maker, write = ros
    tf = [
        ("/tf", t, maker.tf(maker.transform("map", "cam", [t * 1e-9, 0, 0], [0, 0, 0, 1], t)))
        for t in range(0, 10**9, TENTH)
    ]
    bag = write(tf + images(maker, pictures, "cam"))
    with pytest.raises(
        DataError, match=r"the images were taken at .*2023-11-14.*covers 0.000 s to 0.900 s; these are two clocks"
    ):
        planned(bag)
