"""Images of bags that an independent library wrote come back bit for bit; what cannot be read is said."""

from __future__ import annotations

import contextlib

import cv2
import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.cameras import BrownConradyCamera, KannalaBrandtCamera
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_sensor
from omnilab_recordings import Mcap, RosBag
from omnilab_recordings.bags.bag_stream import Stamps
from omnilab_recordings.on_bad_image import OnBadImage

BEGIN_NS = 1_700_000_000_000_000_000
TENTH = 10**8
SPHERE = {"panorama": "equirectangular"}


def taken(sensor: RosBag) -> np.ndarray:
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))])


def sequence(maker, pictures, topic: str = "/cam/image_raw", **settings) -> list:
    """Images a tenth of a second apart, recorded 20 ms after they were taken."""
    at = [BEGIN_NS + i * TENTH for i in range(len(pictures))]
    return [(topic, t + TENTH // 5, maker.image(p, t, **settings)) for t, p in zip(at, pictures, strict=True)]


# --------------------------------------------------------------------------------------------------------- bit for bit
def test_grey_images_and_their_times(ros, pictures) -> None:
    maker, write = ros
    bag = write(sequence(maker, pictures, pad=5))
    sensor = RosBag(str(bag), **SPHERE)
    assert np.array_equal(taken(sensor), pictures)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.stamps_ns.tolist() == [BEGIN_NS + i * TENTH for i in range(8)]
    recorded = RosBag(str(bag), stamps=Stamps.record, **SPHERE).stream.stamps_ns
    assert recorded[0] == BEGIN_NS + TENTH // 5
    check_sensor(RosBag(str(bag), every=2, **SPHERE), RecordedPoses())


def test_packed_bags_and_single_files(ros, pictures) -> None:
    maker, write = ros
    messages = sequence(maker, pictures)
    packings = {"ros1": ("lz4", "bz2"), "mcap": ("storage",)}.get("ros1" if maker.version == 1 else "", ())
    for packed in packings:
        assert np.array_equal(taken(RosBag(str(write(messages, packed, packed=packed)), **SPHERE)), pictures)
    bag = write(messages, "plain")
    for file in bag.glob("*.db3") if bag.is_dir() else [bag]:
        assert np.array_equal(taken(RosBag(str(file), **SPHERE)), pictures)


def test_encodings_become_rgb_or_grey(ros) -> None:
    maker, write = ros
    rng = np.random.default_rng(2)
    rgb = cv2.GaussianBlur(rng.integers(0, 255, (20, 64, 3), np.uint8), (9, 9), 3)
    opaque = np.full((20, 64), 255, np.uint8)
    deep = rng.integers(0, 2**16, (20, 64), np.uint16)
    rggb = np.zeros((20, 64), np.uint8)
    for i, j, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        rggb[i::2, j::2] = rgb[i::2, j::2, channel]
    sent = {
        "rgb8": rgb, "bgr8": rgb[..., ::-1], "8UC3": rgb[..., ::-1], "rgba8": np.dstack([rgb, opaque]),
        "bgra8": np.dstack([rgb[..., ::-1], opaque]), "mono16": deep, "bayer_rggb8": rggb,
    }  # fmt: skip
    messages = [
        (f"/{name}", BEGIN_NS, maker.image(np.ascontiguousarray(pixels), BEGIN_NS, name))
        for name, pixels in sent.items()
    ]
    bag = str(write(messages))
    for name in ("rgb8", "bgr8", "8UC3", "rgba8", "bgra8"):
        assert np.array_equal(taken(RosBag(bag, topic=f"/{name}", color=True, **SPHERE))[0], rgb), name
    assert np.array_equal(taken(RosBag(bag, topic="/mono16", **SPHERE))[0], deep >> 8)
    inside = np.s_[2:-2, 2:-2]
    bayer = taken(RosBag(bag, topic="/bayer_rggb8", color=True, **SPHERE))[0]
    assert (
        np.abs(bayer[inside].astype(int) - rgb[inside]).mean(axis=(0, 1)).max() < 4
    )  # the pattern's channels are right
    assert "upper 8" in RosBag(bag, topic="/mono16", **SPHERE).stream.remarks["encoding"]


def test_compressed_images(ros, pictures) -> None:
    maker, write = ros
    messages = [
        (
            "/cam/compressed",
            BEGIN_NS + i * TENTH,
            maker.compressed(cv2.imencode(f".{kind}", p)[1].tobytes(), BEGIN_NS + i * TENTH, said),
        )
        for i, (p, kind, said) in enumerate(
            zip(pictures[:2], ("png", "jpg"), ("mono8; png compressed ", "jpeg"), strict=True)
        )
    ]
    images = taken(RosBag(str(write(messages)), **SPHERE))
    assert np.array_equal(images[0], pictures[0])
    assert np.array_equal(images[1], cv2.imdecode(cv2.imencode(".jpg", pictures[1])[1], cv2.IMREAD_GRAYSCALE))


def test_single_images_are_read_without_the_others(ros, pictures) -> None:
    maker, write = ros
    sensor = RosBag(str(write(sequence(maker, pictures))), **SPHERE)
    plan = sensor.plan(RecordedPoses()).at([1, 6])
    (frames,) = sensor.frames(plan)
    assert np.array_equal(frames.images, pictures[[1, 6]])


def test_mcap_is_the_same_sensor(pictures, ros) -> None:
    maker, write = ros
    assert np.array_equal(taken(Mcap(str(write(sequence(maker, pictures))), **SPHERE)), pictures)


# -------------------------------------------------------------------------------------------------------------- topics
def test_two_topics_of_images_are_listed(ros, pictures) -> None:
    maker, write = ros
    bag = write(sequence(maker, pictures) + sequence(maker, pictures[:3], "/rear/image_raw"))
    with pytest.raises(
        ConfigError,
        match=r"images on 2 topics, /cam/image_raw \(8 of 64 x 20 mono8\), /rear.*sensor.topic=/cam/image_raw",
    ):
        RosBag(str(bag)).plan(RecordedPoses())
    assert len(taken(RosBag(str(bag), topic="/rear/image_raw", **SPHERE))) == 3
    with pytest.raises(ConfigError, match=r"topic=/front is not in .*; images are on /cam/image_raw, /rear/image_raw"):
        RosBag(str(bag), topic="/front").plan(RecordedPoses())


def test_topics_without_images_are_listed_with_their_types(ros) -> None:
    maker, write = ros
    bag = write([("/odom", BEGIN_NS, maker.odometry([0, 0, 0], [0, 0, 0, 1], BEGIN_NS))])
    with pytest.raises(
        DataError, match=r"has no images \(sensor_msgs/Image, .*its topics are /odom \(nav_msgs/Odometry, 1\)"
    ):
        RosBag(str(bag)).plan(RecordedPoses())
    with pytest.raises(ConfigError, match="topic=/odom is of nav_msgs/Odometry, no images"):
        RosBag(str(bag), topic="/odom").plan(RecordedPoses())


def test_encodings_that_are_not_known(ros) -> None:
    maker, write = ros
    depth = np.ones((20, 64), np.float32)
    bag = write([("/depth", BEGIN_NS, maker.image(depth, BEGIN_NS, "32FC1"))])
    with pytest.raises(
        DataError, match="no images that are read: those of /depth are of encoding '32FC1', where mono8"
    ):
        RosBag(str(bag)).plan(RecordedPoses())
    packed = write([("/cam/compressed", BEGIN_NS, maker.compressed(b"xxxx", BEGIN_NS, "h264"))], "packed")
    with pytest.raises(DataError, match="are of format 'h264', where bmp, jpeg"):
        RosBag(str(packed)).plan(RecordedPoses())


# -------------------------------------------------------------------------------------------------------------- damage
def test_broken_images_in_the_middle(ros, pictures) -> None:
    maker, write = ros
    messages = sequence(maker, pictures)
    messages[3] = ("/cam/image_raw", messages[3][1], maker.image(pictures[3][:5], BEGIN_NS, height=20))
    messages[5] = ("/cam/image_raw", messages[5][1], maker.image(np.zeros((9, 9), np.uint8), BEGIN_NS))
    messages[6] = ("/cam/image_raw", messages[6][1], maker.image(pictures[6], BEGIN_NS, height=2**31, width=2**31))
    bag = str(write(messages))
    sensor = RosBag(bag, on_bad_image=OnBadImage.skip, **SPHERE)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert np.array_equal(frames.images, pictures[[0, 1, 2, 4, 7]])
    assert [reason.rpartition("#")[2].partition(",")[0] for reason in frames.omitted] == [
        "3 is truncated: 320 bytes are too few for 64 x 20 pixels",
        "5 is 9 x 9 pixels",
        "6 is 2147483648 x 2147483648 pixels",
    ]
    with pytest.raises(DataError, match=r"#3 is truncated.*sensor.on_bad_image=skip"):
        taken(RosBag(bag, **SPHERE))


def test_bags_that_are_cut_off(ros, pictures, caplog) -> None:
    """Whatever the kind: what lies before the cut is read, without an index, and the damage is said; or a sentence."""
    maker, write = ros
    many = np.random.default_rng(4).integers(0, 255, (80, 100, 400), np.uint8)  # more than one chunk
    bag = write(sequence(maker, many))
    file = next(f for f in (bag.iterdir() if bag.is_dir() else [bag]) if f.suffix in {".bag", ".db3", ".mcap"})
    whole = file.read_bytes()
    for share in (0.5, 0.97):
        file.write_bytes(whole[: int(share * len(whole))])
        sensor = RosBag(str(file), **SPHERE)
        with contextlib.suppress(DataError) if file.suffix == ".db3" else contextlib.nullcontext():
            images = taken(sensor)
            assert np.array_equal(images, many[: len(images)])
            assert sensor.stream.remarks["damage"].startswith("the log is damaged, and what can be read of it is read")
            assert len(images) >= share * len(many) - 30 or file.suffix == ".db3"
    file.write_bytes(whole[:20])
    with pytest.raises(DataError, match="holds no messages; of the file the rest is damaged"):
        RosBag(str(file)).plan(RecordedPoses())


def test_a_bag_of_ros_1_without_an_index_is_read(ros, pictures) -> None:
    maker, write = ros
    if maker.version != 1:
        pytest.skip("only bags of ROS 1 end in an index that a recorder may not have written")
    bag = write(sequence(maker, pictures))
    data = bag.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    bag.write_bytes(data[:at] + bytes(8) + data[at + 8 :])  # as rosbag leaves it when it is killed
    assert np.array_equal(taken(RosBag(str(bag), **SPHERE)), pictures)


def test_stamps_of_headers_that_are_none(ros, pictures) -> None:
    maker, write = ros
    messages = [("/cam", BEGIN_NS + i * TENTH, maker.image(p, 0)) for i, p in enumerate(pictures)]
    stream = RosBag(str(write(messages))).stream
    assert stream.stamps_ns[0] == BEGIN_NS
    assert "the headers of /cam hold no times" in stream.remarks["stamps"]
    back = [("/cam", BEGIN_NS + i * TENTH, maker.image(p, BEGIN_NS - i * TENTH)) for i, p in enumerate(pictures)]
    stream = RosBag(str(write(back, "back"))).stream
    assert "7 of 8 images of /cam are not later than the one before" in stream.remarks["stamps"]


def test_files_that_are_no_log(tmp_path) -> None:
    (tmp_path / "picture.bag").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(DataError, match=r"picture.bag is a PNG picture, no log; give a bag of ROS 1 \(.bag\)"):
        RosBag(str(tmp_path / "picture.bag")).plan(RecordedPoses())
    with pytest.raises(DataError, match=r"nowhere.bag cannot be read"):
        RosBag(str(tmp_path / "nowhere.bag")).plan(RecordedPoses())
    (tmp_path / "picture.bag").rename(tmp_path / "drive_0.db3.zstd")
    with pytest.raises(DataError, match=r"holds no .db3, .mcap or .bag; unpack drive_0.db3.zstd first: zstd -d"):
        RosBag(str(tmp_path)).plan(RecordedPoses())


# -------------------------------------------------------------------------------------------------------------- camera
def test_the_camera_is_that_of_the_camera_info_beside_the_images(ros, pictures) -> None:
    maker, write = ros
    D = np.array([-0.1, 0.01, 0.001, 0.002, 0.0])
    bag = write([("/cam/camera_info", BEGIN_NS, maker.info((20, 64), 50, D=D)), *sequence(maker, pictures)])
    camera = RosBag(str(bag)).optics.camera
    assert isinstance(camera, BrownConradyCamera)
    assert (camera.fx, camera.cx, camera.k1, camera.p2, camera.looks) == (50, 32, -0.1, 0.002, "ahead")
    fisheye = maker.info((20, 64), 20, model="equidistant", D=np.zeros(4))
    bag = write([("/cam/camera_info", BEGIN_NS, fisheye), *sequence(maker, pictures)], "fisheye")
    up = RosBag(str(bag), looks="up").optics.camera
    assert isinstance(up, KannalaBrandtCamera)
    assert up.looks == "up"


def test_a_camera_info_of_another_size_or_of_zeros(ros, pictures) -> None:
    maker, write = ros
    bag = write([("/cam/camera_info", BEGIN_NS, maker.info((480, 640), 300)), *sequence(maker, pictures)])
    with pytest.raises(DataError, match="has a camera of images of 640 x 480 pixels, and images of 64 x 20"):
        taken(RosBag(str(bag)))
    assert len(taken(RosBag(str(bag), **SPHERE))) == 8
    bag = write(
        [("/cam/camera_info", BEGIN_NS, maker.info((20, 64), 0, K=np.zeros(9))), *sequence(maker, pictures)], "zeros"
    )
    stream = RosBag(str(bag)).stream
    assert stream.camera is None
    assert "holds zeros: the camera was not calibrated" in stream.remarks["calibration"]
