"""What is wrong with a folder, its positions file or the request is reported in one sentence."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from omnilab.api import GridPoses, PathPoses, RandomPoses, RecordedPoses
from omnilab.errors import ConfigError, DataError
from omnilab_recordings import Folder
from omnilab_recordings.folder import OnBadImage


def read_all(sensor):
    return list(sensor.frames(sensor.plan(RecordedPoses())))


def blank(count):
    return [np.full((16, 20), 90, np.uint8)] * count


def test_folder_does_not_exist(tmp_path):
    with pytest.raises(DataError, match=r"nowhere does not exist; give sensor\.path=DIR"):
        Folder(tmp_path / "nowhere").plan(RecordedPoses())


def test_folder_is_empty(tmp_path):
    (tmp_path / "notes.txt").write_text("no image")
    with pytest.raises(DataError, match=r"holds no image that matches \*\*/\*"):
        Folder(tmp_path).plan(RecordedPoses())


def cut_short(data):
    return data[: len(data) // 2]


def without_its_end(data):
    return data[:-8]


def zero_filled(data):
    return data[: len(data) // 2] + bytes(len(data) - len(data) // 2)


def text(_):
    return b"<html>not found</html>"


def nothing(_):
    return b""


@pytest.mark.parametrize("ending", ["png", "jpg", "pgm", "bmp", "tif", "webp"])
@pytest.mark.parametrize("damage", [cut_short, without_its_end, zero_filled, text, nothing])
def test_a_damaged_file_is_named_or_left_out(write_recording, ending, damage):
    if damage is zero_filled and ending not in {"png", "jpg"}:
        pytest.skip("zeros are pixels like others in a format without checksum or end mark")
    rng = np.random.default_rng(1)
    images = [cv2.GaussianBlur(rng.integers(0, 256, (64, 80), dtype=np.uint8), (5, 5), 1) for _ in range(4)]
    root = write_recording(images, ending=ending)
    file = root / f"img-2.{ending}"
    file.write_bytes(damage(file.read_bytes()))
    with pytest.raises(DataError, match=rf"^img-2\.{ending} is .*; replace it, or .*sensor\.on_bad_image=skip$"):
        read_all(Folder(root, circle_px=[40, 32, 30]))
    (frames,) = read_all(Folder(root, circle_px=[40, 32, 30], on_bad_image=OnBadImage.skip))
    assert len(frames) == 3
    assert [reason.startswith(f"img-2.{ending} is ") for reason in frames.omitted] == [True]


def test_a_damaged_file_beyond_the_sample_is_named_too(write_grid):
    root = write_grid(10, 10)
    (root / "img-5.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    sensor = Folder(root, circle_px=[10, 10, 8])
    assert next(sensor.frames(sensor.plan(RecordedPoses()).at(range(4)))).images[3, 0, 0] == 13
    with pytest.raises(DataError, match=r"img-5\.png"):
        read_all(sensor)


def test_all_files_are_bad(write_recording):
    root = write_recording(blank(3))
    for file in root.iterdir():
        file.write_bytes(b"no")
    with pytest.raises(DataError, match="can be read"):
        read_all(Folder(root, on_bad_image=OnBadImage.skip))


def test_one_image_has_another_size(write_recording):
    root = write_recording([np.zeros((8, 8), np.uint8), *blank(4)])
    with pytest.raises(DataError, match=r"img-0\.png is 8 x 8 pixels, the recording 20 x 16"):
        read_all(Folder(root))
    (frames,) = read_all(Folder(root, on_bad_image=OnBadImage.skip))
    assert frames.images.shape == (4, 16, 20)
    assert len(frames.omitted) == 1


@pytest.mark.parametrize(("header", "row", "sentence"), [
    ("image,x_m,y_m", "img-1.png,nan,0", r"line 3 of .* has x_m='nan' \(column 2\); write a finite number"),
    ("image,x_m,y_m", "img-1.png,1e400,0", r"line 3 .* x_m='1e400'"),
    ("image,x_m,y_m", "img-1.png,0,", r"line 3 .* y_m=''"),
    ("image,x_m,y_m", "img-1.png,1,5,0", r"line 3 .* has 4 values for 3 columns; write image x_m y_m, with points in numbers: 1\.5"),
    ("image,x_m,y_m", "img-1.png,1", r"line 3 .* has 2 values for 3 columns"),
    ("image,x_m,y_m", "img-0.png,1,2", r"line 3 .* names img-0\.png again, after line 2"),
    ("image,x_m,y_m", 'img-1.png,1,"2', r"line 3 .* a quotation mark that does not close"),
    ("image,x_m,y", "img-1.png,1,2", r"has a column 'y', which is not read; write y_m \(in metres\), y_cm or y_mm, or remove it"),
    ("image,x_m,x_m", "img-1.png,1,2", r"two columns of one name"),
    ("image;x_m;y_m", "img-1.png;1;2", r"separates its columns by semicolons; use commas, and points in numbers"),
    ("image,x_m,y_m,ix,iy", "img-1.png,1,2,0.5,1", r"line 3 .* ix='0\.5' \(column 4\); write a whole number"),
    ("image,x_m,y_m,ix", "img-1.png,1,2,0", r"has no column iy"),
    ("image,x_m,y_m,stamp_ns", "img-1.png,1,2,9223372036854775808", r"line 3 .* stamp_ns="),
    ("image,x_m,y_m,z_m", "img-1.png,1,2,inf", r"line 3 .* z_m='inf'"),
    ("image,x_m,y_m,yaw_deg", "img-1.png,1,2,north", r"line 3 .* yaw_deg='north'"),
])  # fmt: skip
def test_a_bad_line_of_the_positions_is_reported(write_recording, header, row, sentence):
    separator = ";" if ";" in header else ","
    good = separator.join(["img-0.png", *["0"] * header.count(separator)])
    root = write_recording(blank(2), [good, row], header)
    with pytest.raises(DataError, match=sentence):
        Folder(root).plan(RecordedPoses())


def test_positions_without_rows(write_recording):
    with pytest.raises(DataError, match="holds no pose"):
        Folder(write_recording(blank(1), [])).plan(RecordedPoses())


def test_positions_that_are_no_text(write_recording):
    root = write_recording(blank(1))
    (root / "positions.csv").write_bytes(b"image,x_m,y_m\nimg-0.png,\xff\xfe,0\n")
    with pytest.raises(DataError, match=r"line 2 of .* is no text in UTF-8; save the file as UTF-8"):
        Folder(root).plan(RecordedPoses())


def test_positions_file_that_was_requested_does_not_exist(write_recording):
    with pytest.raises(DataError, match=r"truth\.csv does not exist"):
        Folder(write_recording(blank(1)), positions="truth.csv").plan(RecordedPoses())


def test_positions_too_large(write_recording, monkeypatch):
    root = write_recording(blank(2), ["img-0.png,0,0", "img-1.png,1,0"])
    monkeypatch.setattr("omnilab.trajectory.tables.MOST_POSES", 1)
    with pytest.raises(DataError, match="more than 1 rows"):
        Folder(root).plan(RecordedPoses())
    monkeypatch.setattr("omnilab.trajectory.tables.LARGEST_FILE", 10)
    with pytest.raises(DataError, match="bytes, more than 10"):
        Folder(root).plan(RecordedPoses())


def test_images_too_large(write_recording, monkeypatch):
    monkeypatch.setattr("omnilab_recordings.images.files.LARGEST_FILE", 10)
    with pytest.raises(DataError, match=r"img-0\.png cannot be read .it has \d+ bytes, more than 10"):
        read_all(Folder(write_recording(blank(1))))


def test_positions_do_not_match_the_images(write_recording):
    rows = ["img-0.png,0,0", "a.png,1,0", "b.png,1,0", "c.png,1,0", "d.png,1,0"]
    root = write_recording(blank(3), rows)
    sentence = r"names 4 images that are not there \(a\.png, b\.png, c\.png, \.\.\.\) and does not name 2 that are \(img-1\.png, img-2\.png\)"
    with pytest.raises(DataError, match=sentence):
        Folder(root).plan(RecordedPoses())


def test_images_elsewhere_below_the_folder_are_not_missed(write_recording):
    root = write_recording(blank(2), ["img-0.png,0,0", "img-1.png,1,0"])
    (root / "calibration").mkdir()
    cv2.imwrite(str(root / "calibration" / "board.png"), blank(1)[0])
    (root / "._img-0.png").write_bytes(b"what another system keeps beside a file")
    assert len(Folder(root).plan(RecordedPoses())) == 2


def test_an_image_outside_the_folder_is_not_read(write_recording, tmp_path_factory):
    other = tmp_path_factory.mktemp("elsewhere") / "secret.png"
    cv2.imwrite(str(other), blank(1)[0])
    root = write_recording(blank(1), ["img-0.png,0,0", f"{other},1,0", f"../{other.parent.name}/secret.png,1,0"])
    with pytest.raises(DataError, match="names 2 images that are not there"):
        Folder(root).plan(RecordedPoses())


@pytest.mark.parametrize(
    "layout", [RandomPoses(3, seed=0), PathPoses(np.eye(4)[None]), GridPoses(every=9, extent_m=(0.1, 0.1), height_m=5)]
)
def test_what_there_is_instead(write_grid, layout):
    remedy = r"study\.queries=rest, of robustness study\.every=2$"
    with pytest.raises(DataError, match=rf"holds 20 images on a 5 × 4 grid at 0\.5 m, and none .*{remedy}"):
        Folder(write_grid(5, 4, 0.5)).plan(layout)


def test_a_step_between_recorded_ones(write_grid):
    sensor = Folder(write_grid(5, 4, 0.5))
    for step_m in (0.25, 0.75, 0.0, -0.5):
        with pytest.raises(DataError, match=r"no whole multiple of the 0\.5 m .*; give 0\.5 m, 1\.0 m, 1\.5 m"):
            sensor.plan(GridPoses(step_m=step_m))


@pytest.mark.parametrize("layout", [GridPoses(every=0), GridPoses(every=1, step_m=0.5)])
def test_a_grid_that_cannot_be_meant(write_grid, layout):
    with pytest.raises(ConfigError, match="every="):
        Folder(write_grid()).plan(layout)


def test_nothing_is_left(write_grid):
    with pytest.raises(DataError, match="holds 20 images"):
        Folder(write_grid()).plan(RecordedPoses(without=GridPoses(every=1)))


@pytest.mark.parametrize(
    "layout", [GridPoses(every=2), RecordedPoses(without=GridPoses(every=2)), RandomPoses(2, seed=1)]
)
def test_layouts_need_positions(write_recording, layout):
    with pytest.raises(DataError, match=r"holds 3 images without positions, .*write a positions\.csv$"):
        Folder(write_recording(blank(3))).plan(layout)


def test_positions_that_form_no_grid(write_recording):
    rows = ["img-0.png,0,0", "img-1.png,0.31,1", "img-2.png,1.2,0.13"]
    sensor = Folder(write_recording(blank(3), rows))
    assert len(sensor.plan(RecordedPoses())) == 3
    with pytest.raises(DataError, match=r"at positions that form no grid, .* ix and iy"):
        sensor.plan(GridPoses(every=2))


def test_masks_that_do_not_fit(write_recording):
    root = write_recording(blank(2))
    with pytest.raises(DataError, match=r"the mask drone\.png cannot be read .*sensor\.mask=FILE"):
        read_all(Folder(root, mask="drone.png"))
    cv2.imwrite(str(root / "drone.png"), np.zeros((5, 5), np.uint8))
    with pytest.raises(DataError, match=r"the mask drone\.png is 5 x 5 pixels, the recording 20 x 16"):
        read_all(Folder(root, mask="drone.png"))


@pytest.mark.parametrize(
    "circle_px", [[1, 2], [1, 2, 3, 4, 5], [1, 2, 0], [1, 2, -3], [1, 2, 3, 3], [1, 2, 3, -1], [1, float("nan"), 3]]
)
def test_a_circle_that_is_none(circle_px):
    with pytest.raises(ConfigError, match=r"circle_px=\["):
        Folder("x", circle_px=circle_px)


def test_a_circle_beside_the_image(write_recording):
    with pytest.raises(ConfigError, match="centre outside the 20 x 16 image"):
        read_all(Folder(write_recording(blank(1)), circle_px=[30, 8, 5]))


@pytest.mark.parametrize(
    "settings",
    [{"batch": 0}, {"turned_deg": float("nan")}, {"pattern": ""}, {"pattern": "/tmp/*"}, {"pattern": "../*.png"}],
)
def test_settings_that_cannot_be_meant(settings):
    with pytest.raises(ConfigError, match=next(iter(settings))):
        Folder("x", **settings)
