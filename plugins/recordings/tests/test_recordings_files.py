"""Which image files there are below a folder: links, names in two forms of Unicode, pipes, patterns."""

from __future__ import annotations

import os
import unicodedata

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import RecordedPoses
from omnilab.errors import DataError
from omnilab_recordings import Folder
from omnilab_recordings.folder import OnBadImage
from omnilab_recordings.images.files import image_names

NFC, NFD = (unicodedata.normalize(form, "café") for form in ("NFC", "NFD"))


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def picture(file, grey=90):
    file.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(file), np.full((16, 20), grey, np.uint8))


# ----------------------------------------------------------------------------------------------------------- links
def test_a_link_to_a_folder_elsewhere_is_followed(tmp_path):
    touch(tmp_path, "elsewhere/0.png", "elsewhere/deep/1.png", "data/2.png")
    (tmp_path / "data/images").symlink_to(tmp_path / "elsewhere")
    assert image_names(tmp_path / "data", "**/*") == ["2.png", "images/0.png", "images/deep/1.png"]
    assert image_names(tmp_path / "data", "images/*.png") == ["images/0.png"]


def test_links_that_lead_in_circles_or_back_add_nothing(tmp_path):
    touch(tmp_path, "data/0.png", "data/deep/1.png", "other/secret.png")
    (tmp_path / "data/deep/self").symlink_to(tmp_path / "data/deep")
    (tmp_path / "data/up").symlink_to("..")
    (tmp_path / "data/a").symlink_to(tmp_path / "data/b")
    (tmp_path / "data/b").symlink_to(tmp_path / "data/a")
    assert image_names(tmp_path / "data", "**/*") == ["0.png", "deep/1.png"]


def test_images_keep_their_own_path_where_a_link_leads_there_too(tmp_path):
    touch(tmp_path, "run/0.png")
    (tmp_path / "latest").symlink_to("run")
    assert image_names(tmp_path, "**/*") == ["run/0.png"]


def test_two_links_into_each_other(tmp_path):
    touch(tmp_path, "a/0.png", "b/1.png", "data/2.png")
    (tmp_path / "a/b").symlink_to(tmp_path / "b")
    (tmp_path / "b/a").symlink_to(tmp_path / "a")
    (tmp_path / "data/a").symlink_to(tmp_path / "a")
    assert image_names(tmp_path / "data", "**/*") == ["2.png", "a/0.png", "a/b/1.png"]


def test_a_link_that_leads_nowhere_is_named(tmp_path):
    (tmp_path / "images").symlink_to("/nowhere/images")
    with pytest.raises(DataError, match=r"and images is a link to /nowhere/images, which is not there; give"):
        Folder(tmp_path).plan(RecordedPoses())


def test_a_link_to_a_whole_disk_is_refused(tmp_path, monkeypatch):
    touch(tmp_path, *(f"disk/{i}.txt" for i in range(9)), "data/0.png")
    (tmp_path / "data/images").symlink_to(tmp_path / "disk")
    monkeypatch.setattr("omnilab_recordings.images.files.MOST_FILES", 8)
    with pytest.raises(DataError, match=r"holds more than 8 files; give sensor\.path=DIR"):
        image_names(tmp_path / "data", "**/*")


# -------------------------------------------------------------------------------------------------------- patterns
NAMES = ["0.png", "a/1.png", "a/b/2.png", "a/b/3.PNG", "b/4.jpg", "rgb/5.png", "a/.hidden/6.png", ".7.png", "8.txt"]


@pytest.mark.parametrize(
    "pattern",
    [
        "**/*",
        "*",
        "*/*",
        "**/*.png",
        "a/**/*.png",
        "**/b/*",
        "rgb/*",
        "a/*/2.*",
        "?/*",
        "[ab]/*",
        "*.png",
        "**/**/*",
        "a",
    ],
)
def test_patterns_mean_what_pathlib_says(tmp_path, pattern):
    touch(tmp_path, *NAMES)
    among = {name for name in NAMES if "." not in name[0] and "/." not in name and not name.endswith("txt")}
    expected = {path.relative_to(tmp_path).as_posix() for path in tmp_path.glob(pattern)} & among
    assert set(image_names(tmp_path, pattern)) == expected


# ------------------------------------------------------------------------------------------------- Unicode's forms
@pytest.mark.parametrize(("on_disk", "in_file"), [(NFD, NFC), (NFC, NFD)])
def test_names_are_compared_whatever_their_form(tmp_path, on_disk, in_file):
    for i in range(3):
        picture(tmp_path / f"{on_disk}/{on_disk}{i}.png", 50 + i)
    picture(tmp_path / f"{on_disk}.png", 255)
    rows = [f"{in_file}/{in_file}{i}.png,{i},0" for i in (2, 0, 1)]
    (tmp_path / f"{on_disk}.csv").write_text("\n".join(["image,x_m,y_m", *rows]))
    sensor = Folder(tmp_path, positions=f"{in_file}.csv", pattern=f"{in_file}/*", mask=f"{in_file}.png")
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.images[:, 8, 10].tolist() == [52, 50, 51]
    assert frames.T_world_camera[:, 0, 3].tolist() == [2, 0, 1]


def test_the_folder_itself_is_found_in_the_other_form(tmp_path):
    picture(tmp_path / NFD / "a" / "0.png")
    assert len(Folder(tmp_path / NFC / "a").plan(RecordedPoses())) == 1


def test_two_files_that_differ_in_nothing_but_their_form_are_two(tmp_path):
    for grey, name in (50, f"{NFC}.png"), (60, f"{NFD}.png"):
        picture(tmp_path / name, grey)
    if len(list(tmp_path.iterdir())) < 2:
        pytest.skip("this file system takes them for one")
    (tmp_path / "positions.csv").write_text(f"image,x_m,y_m\n{NFD}.png,0,0\n{NFC}.png,1,0\n")
    sensor = Folder(tmp_path)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.images[:, 0, 0].tolist() == [60, 50]


def test_one_file_in_two_rows_of_two_forms_is_said(tmp_path):
    picture(tmp_path / f"{NFC}.png")
    (tmp_path / "positions.csv").write_text(f"image,x_m,y_m\n{NFD}.png,0,0\n{NFC}.png,1,0\n")
    with pytest.raises(DataError, match=r"names .*\.png twice, in two forms of Unicode; mend its rows"):
        Folder(tmp_path).plan(RecordedPoses())


# --------------------------------------------------------------------------------------------------- what is no file
@pytest.mark.parametrize("name", ["x" * 5000, "nul\0byte", "gone", "gone/deeper", ""])
def test_a_folder_that_cannot_be(tmp_path, name):
    with pytest.raises(DataError, match=r"does not exist|cannot be read|holds no image"):
        Folder(tmp_path / name if "\0" not in name else name).plan(RecordedPoses())


@pytest.mark.timeout(20)
def test_a_pipe_among_images_does_not_wait_for_ever(tmp_path):
    picture(tmp_path / "0.png")
    os.mkfifo(tmp_path / "1.png")
    sensor = Folder(tmp_path)
    with pytest.raises(
        DataError,
        match=r"^1\.png cannot be read .it is a pipe or a device, no file.; replace it, or .*on_bad_image=skip$",
    ):
        list(sensor.frames(sensor.plan(RecordedPoses())))
    sensor = Folder(tmp_path, on_bad_image=OnBadImage.skip)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.omitted == ["1.png cannot be read (it is a pipe or a device, no file)"]


def test_a_device_and_a_folder_are_no_images(tmp_path):
    picture(tmp_path / "0.png")
    (tmp_path / "1.png").mkdir()
    (tmp_path / "2.png").symlink_to("/dev/zero")
    sensor = Folder(tmp_path)
    with pytest.raises(DataError, match=r"^2\.png cannot be read .it is a pipe or a device, no file"):
        list(sensor.frames(sensor.plan(RecordedPoses())))
    (tmp_path / "2.png").unlink()
    (tmp_path / "2.png").symlink_to(tmp_path / "gone.png")
    with pytest.raises(DataError, match=r"^2\.png cannot be read \(No such file"):
        list(sensor.frames(sensor.plan(RecordedPoses())))


@given(st.lists(st.sampled_from(["**", "*", "a", "b*", "?"]), min_size=1, max_size=6))
def test_every_pattern_ends(pattern):
    from omnilab_recordings.images.files import _matches

    _matches(["a"] * 12, pattern)
