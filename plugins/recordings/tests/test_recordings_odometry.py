"""Wheel odometry from files made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Circle, Frames
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_odometry
from omnilab_recordings import Recorded

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))
START = 1_700_000_000  # seconds since 1970: too many nanoseconds for a float
CSV = "x_m,y_m,z_m,yaw_deg\n5,5,0,90\n5,6,0,90\n4,6,0,170\n4,6,0,-170\n"


def frames(stamps_s=(0, 1, 2), rows=None):
    count = len(stamps_s)
    stamps = START * 10**9 + np.array([round(s * 10**9) for s in stamps_s], np.int64)
    rows = np.arange(count) if rows is None else np.array(rows)
    return Frames(np.zeros((count, 16, 16), np.uint8), [str(i) for i in range(count)], stamps, CAMERA, rows)


def tum(path, rows):
    """Seconds, x, y, heading in degrees."""
    half = [(t, x, y, np.deg2rad(h) / 2) for t, x, y, h in rows]
    path.write_text("".join(f"{START + t} {x} {y} 0 0 0 {np.sin(h):.15f} {np.cos(h):.15f}\n" for t, x, y, h in half))
    return Recorded(str(path))


def table(tmp_path, text=CSV):
    (tmp_path / "wheels.csv").write_text(text)
    return Recorded(str(tmp_path / "wheels.csv"))


def motion(odometry, images):
    readings = odometry.extract(images)
    return odometry.estimate(readings[0], readings[-1], np.random.default_rng(1))


def test_conforms(tmp_path):
    check_odometry(table(tmp_path), frames())
    check_odometry(tum(tmp_path / "wheels.tum", [(0, 0, 0, 0), (1, 1, 0, 30), (2, 2, 1, 60)]), frames())


def test_rows_without_stamps_are_those_of_the_plan(tmp_path):
    found = motion(table(tmp_path), frames((7, 9), rows=[1, 2]))  # one metre to the left, while turning left
    assert found.vector == pytest.approx([0, 1, np.deg2rad(80)])
    assert found.unit == "m"
    across = motion(table(tmp_path), frames((0, 1), rows=[2, 3]))  # 170 to -170 degrees
    assert across.vector == pytest.approx([0, 0, np.deg2rad(20)])


def test_too_short_a_file_is_reported(tmp_path):
    with pytest.raises(DataError, match=r"has 4 poses and no stamps, and image 5 is requested; give a pose"):
        table(tmp_path).extract(frames((0, 1), rows=[3, 4]))


def test_stamps_are_interpolated_across_half_a_turn(tmp_path):
    odometry = tum(tmp_path / "wheels.tum", [(0, 0, 0, 170), (2, 4, 0, 190), (3, 4, 0, 190)])
    at = np.array([reading.pose for reading in odometry.extract(frames((0, 0.5, 1)))])
    assert at[:, 0] == pytest.approx([0, 1, 2])
    assert np.rad2deg(at[:, 2]) == pytest.approx([170, 175, 180])
    exact = odometry.extract(frames((1e-6,)))[0].pose[0]  # a microsecond after the first
    assert exact == pytest.approx(2e-6, rel=1e-6)


def test_images_before_and_after_the_file_fail_in_words(tmp_path):
    odometry = tum(tmp_path / "wheels.tum", [(0, 0, 0, 0), (1, 1, 0, 0)])
    for outside in ((-0.1, 0.5), (0.5, 1.1)):
        assert "file" in motion(odometry, frames(outside)).failed
    assert not motion(odometry, frames((0, 1))).failed


@pytest.mark.parametrize(("shift_s", "sentence"), [
    (-START, r"taken at 1700000000\.000 s \(2023-11-14 22:13:20 UTC\) to .*, and .*wheels\.tum covers 0\.000 s to 2\.000 s; these are two clocks"),
    (3600, r"covers 1700003600\.000 s .*about -3600\.000 s"),  # a time zone
    (-18, r"covers 1699999982\.000 s .*about 18\.000 s"),  # leap seconds
])  # fmt: skip
def test_wheels_of_another_clock_are_refused_with_both_ranges(tmp_path, shift_s, sentence):
    with pytest.raises(DataError, match=sentence):
        tum(tmp_path / "wheels.tum", [(shift_s + t, t, 0, 0) for t in range(3)]).extract(frames())


@pytest.mark.parametrize(("factor", "unit"), [(1000, "milliseconds"), (10**6, "microseconds")])
def test_wheels_in_another_unit_of_time(tmp_path, factor, unit):
    rows = "".join(f"{(8 + t) * factor},{t},0\n" for t in range(3))
    (tmp_path / "wheels.csv").write_text(f"stamp_s,x_m,y_m\n{rows}")
    images = frames()
    images.stamps_ns[:] = np.array([8, 9, 10]) * 10**9
    with pytest.raises(
        DataError, match=rf"the times in .* look like {unit} where seconds belong: divide them by {factor}$"
    ):
        Recorded(str(tmp_path / "wheels.csv")).extract(images)


def test_wheels_are_asked_about_like_a_folder(tmp_path, caplog):
    angle = 2 * np.pi * np.arange(20) / 20
    rows = "".join(f"{a * 1000:.0f},{np.cos(a):.5f},{np.sin(a):.5f},{-np.rad2deg(a):.3f}\n" for a in angle)
    odometry = table(tmp_path, f"stamp_s,x_m,y_m,yaw_deg\n{rows}")
    images = frames()
    images.stamps_ns[:] = np.array([0, 1, 2]) * 10**9
    odometry.extract(images)
    assert [message.removeprefix(str(tmp_path / "wheels.csv: "))[:50] for message in caplog.messages] == [
        "headings turn against the path; if they run clockw", "its poses are 314 s apart, and what lies between i",
    ]  # fmt: skip


def test_wheels_that_start_late_are_waited_for(tmp_path):
    odometry = tum(tmp_path / "wheels.tum", [(t, t, 0, 0) for t in range(5, 15)])
    assert np.isnan(odometry.extract(frames((0,)))[0].pose).all()
    assert odometry.extract(frames((6,)))[0].pose[0] == 6
    assert np.isnan(odometry.extract(frames((99,)))[0].pose).all()  # and the rest of the images may come long after


def test_the_covariance_is_that_of_the_settings(tmp_path):
    table(tmp_path)
    odometry = Recorded(str(tmp_path / "wheels.csv"), 0.1, 0.01, 2.0, 0.1)
    step = np.sqrt(np.diag(motion(odometry, frames((0, 1), rows=[1, 2])).covariance))
    assert step == pytest.approx([np.hypot(0.1, 0.01)] * 2 + [np.deg2rad(np.hypot(2, 8))])


def test_a_file_out_of_order_is_reported(tmp_path):
    with pytest.raises(DataError, match=r"pose 3 of .* is not later"):
        tum(tmp_path / "wheels.tum", [(0, 0, 0, 0), (2, 1, 0, 0), (1, 2, 0, 0)]).extract(frames())


def test_settings_and_files_that_are_wrong_are_reported(tmp_path):
    with pytest.raises(ConfigError, match="heading_noise_deg=0 is out of range; give"):
        Recorded(heading_noise_deg=0)
    with pytest.raises(DataError, match="cannot be read"):
        Recorded(str(tmp_path / "none.tum")).extract(frames())
