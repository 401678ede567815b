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
    """A function: the values of one column of the converted log."""
    from rerun.chunk import RrdReader

    recording = tmp_path_factory.mktemp("converted") / "run.rrd"
    binary = Path(rerun_cli.__file__).with_name("rerun")
    convert = [binary, "mcap", "convert", run / "run.mcap", "-o", recording]
    subprocess.run(convert, env=QUIET, check=True, capture_output=True, timeout=60)

    def column(topic, component):
        batches = [chunk.to_record_batch() for chunk in RrdReader(recording).stream().filter(content=topic).to_chunks()]
        (values,) = [batch.column(component).to_pylist() for batch in batches if component in batch.schema.names]
        return values[0]

    return column


def test_image_is_shown(converted, records):
    (blob,) = converted("/camera/image", "EncodedImage:blob")
    pixels = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(pixels[..., ::-1], records["camera/image"].pixels)


def test_pose_is_shown(converted):
    assert converted("/camera/pose", "InstancePoses3D:translations") == [[1, 2, 3]]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        converted("/camera/pose", "InstancePoses3D:quaternions"), [[0, 0, half, half]], rtol=1e-6
    )
    assert converted("/tf", "Transform3D:child_frame") == ["camera"]
    np.testing.assert_allclose(converted("/tf", "Transform3D:quaternion"), [[0, 0, half, half]], rtol=1e-6)


def test_places_are_shown(converted, records):
    np.testing.assert_allclose(converted("/places", "InstancePoses3D:translations"), records["/places"].position_m)


def test_distances_are_shown(converted, records):
    np.testing.assert_allclose(converted("/distances", "Points3D:positions"), records["/distances"].position_m)


def test_signature_is_shown(converted, records):
    (buffer,) = converted("/camera/signature", "Image:buffer")
    values = np.array(buffer, np.uint8).view("<f4").reshape(5, 7)
    np.testing.assert_array_equal(values, records["/camera/signature"].values)


def test_text_is_shown(converted):
    assert converted("/log", "TextLog:text") == ["the map is ready"]
    assert converted("/log", "TextLog:level") == ["WARN"]


def test_values_are_columns(converted):
    assert converted("/error", "omnilab.Scalar:message")[0]["value"] == 0.5
    assert converted("/query", "omnilab.Estimate:message")[0]["verdict"] == "second"
