"""Rerun reads the log, too: converted by its own program, then looked into."""

import os
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

rerun_cli = pytest.importorskip("rerun_cli", reason="rerun-sdk is not installed")
QUIET = os.environ | {"CI": "1", "HTTPS_PROXY": "http://127.0.0.1:9"}  # sends no usage statistics, looks for no update


@pytest.fixture(scope="module")
def converted(run, tmp_path_factory):
    """A function: the rows of one column of the converted log."""
    from rerun.chunk import RrdReader

    recording = tmp_path_factory.mktemp("converted") / "run.rrd"
    binary = Path(rerun_cli.__file__).with_name("rerun")
    convert = [binary, "mcap", "convert", run / "run.mcap", "-o", recording]
    subprocess.run(convert, env=QUIET, check=True, capture_output=True, timeout=60)

    def column(topic, component):
        chunks = RrdReader(recording).stream().filter(content=topic).to_chunks()
        batches = [chunk.to_record_batch() for chunk in chunks]
        return [
            row for batch in batches if component in batch.schema.names for row in batch.column(component).to_pylist()
        ]

    return column


def test_image_is_shown(converted, records):
    ((blob,),) = converted("/camera/image", "EncodedImage:blob")
    pixels = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(pixels[..., ::-1], records["camera/image"].pixels)


def test_pose_is_shown(converted):
    assert converted("/camera/pose", "InstancePoses3D:translations") == [[[1, 2, 3]]]
    half = np.sqrt(0.5)
    (turns,) = converted("/camera/pose", "InstancePoses3D:quaternions")
    np.testing.assert_allclose(turns, [[0, 0, half, half]], rtol=1e-6)


def test_pictures_hang_together_with_the_world(converted):
    """Else the 3-D view that Rerun lays out by itself stays empty."""
    assert converted("/tf", "Transform3D:parent_frame") == [["world"], ["camera"]]
    assert converted("/tf", "Transform3D:child_frame") == [["camera"], ["camera_image_plane"]]
    for topic in "/camera/image", "/camera/signature":
        assert converted(topic, "CoordinateFrame:frame") == [["camera_image_plane"]]


def test_places_are_shown(converted, records):
    (positions,) = converted("/places", "InstancePoses3D:translations")
    np.testing.assert_allclose(positions, records["/places"].position_m)


def test_distances_are_shown(converted, records):
    (positions,) = converted("/distances", "Points3D:positions")
    np.testing.assert_allclose(positions, records["/distances"].position_m)


def test_a_point_cloud_is_shown_in_its_colours(converted, records):
    (positions,) = converted("/cloud", "Points3D:positions")
    np.testing.assert_allclose(positions, records["/cloud"].points_m)
    (colors,) = converted("/cloud", "Points3D:colors")
    red = [color >> 24 for color in colors]
    assert red == records["/cloud"].colors[:, 0].tolist()


def test_signature_is_shown(converted, records):
    ((buffer,),) = converted("/camera/signature", "Image:buffer")
    values = np.array(buffer, np.uint8).view("<f4").reshape(5, 7)
    np.testing.assert_array_equal(values, records["/camera/signature"].values)


def test_text_is_shown(converted):
    assert converted("/log", "TextLog:text") == [["the map is ready"]]
    assert converted("/log", "TextLog:level") == [["WARN"]]


def test_own_messages_are_columns(converted, records):
    rows = converted("/error", "omnilab.Scalar:message")
    assert [row["value"] for (row,) in rows] == records["/error"].values.tolist()
    ((estimate,),) = converted("/query", "omnilab.Estimate:message")
    assert estimate["verdict"] == "second"
