"""Panoramas in folders: the setting, its conventions, who proposes it, and what runs on them."""

from __future__ import annotations

import os
import re

import cv2
import numpy as np
import pytest
from omegaconf import OmegaConf

from omnilab.api import RecordedPoses
from omnilab.cameras import CylindricalCamera, EquirectangularCamera, HyperbolicMirror, load_camera, save_camera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.image import mirror_view, panorama
from omnilab_recordings import Folder
from omnilab_recordings.checks.command import check
from omnilab_recordings.panoramas import Panorama


def world(camera, seed=0, phase_deg=0.0):
    """A smooth world over directions, as a camera sees it: (H, W)."""
    v, u = np.indices((camera.height, camera.width))
    x, y, z = np.moveaxis(camera.directions(np.stack([u, v], -1).astype(float)), -1, 0)
    azimuth, rng = np.arctan2(y, x) + np.deg2rad(phase_deg), np.random.default_rng(seed)
    waves = sum(
        rng.normal() * np.cos(k * azimuth + rng.uniform(0, 6)) * np.cos(m * z + rng.uniform(0, 6))
        for k in range(1, 9) for m in range(4)
    )  # fmt: skip
    return np.nan_to_num(np.clip(128 + 30 * waves, 40, 255), nan=3).astype(np.uint8)  # dark off the mirror


def write(folder, images):
    folder.mkdir(exist_ok=True)
    for i, image in enumerate(images):
        assert cv2.imwrite(str(folder / f"{i}.png"), image)
    return folder


def read_all(sensor):
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))])


def warnings_of(caplog):
    return [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]


@pytest.fixture
def findings(capsys, monkeypatch):
    monkeypatch.setattr("omnilab_recordings.checks.command.write_report_picture", lambda *_: None)

    def findings(folder, *options):
        assert check([str(folder), "-o", os.devnull + ".png", *options]) == 0
        return capsys.readouterr().out

    return findings


# ------------------------------------------------------------------------------------------------------ conventions
@pytest.mark.parametrize("width", [128, 127, 129])
def test_two_to_one_is_the_whole_sphere_with_the_front_in_the_middle(tmp_path, width):
    root = write(tmp_path, [np.full((64, width), 90, np.uint8)])
    camera = Folder(root, panorama="equirectangular").optics.camera
    assert isinstance(camera, EquirectangularCamera)
    assert (camera.start_deg, camera.clockwise) == (180, True)
    lowest, highest = np.rad2deg(camera.elevations_rad)
    assert (lowest, highest) == pytest.approx((-90, 90), abs=0.8)
    front, left, up = camera.directions(np.array([[width / 2, 31.5], [width / 4, 31.5], [width / 2, 0.0]]))
    assert front == pytest.approx([1, 0, 0], abs=1e-6)
    assert left == pytest.approx([0, 1, 0], abs=1e-6)  # clockwise: what is left of the middle is on the left
    assert up[2] > 0.99


def test_a_wider_equirectangular_one_is_its_middle(tmp_path):
    camera = Folder(write(tmp_path, [np.full((40, 160), 90, np.uint8)]), panorama="equirectangular").optics.camera
    assert np.rad2deg(camera.elevations_rad) == pytest.approx([-45, 45])


def test_a_strip_is_a_cylinder_of_square_pixels(tmp_path):
    camera = Folder(write(tmp_path, [np.full((25, 120), 90, np.uint8)]), panorama="strip").optics.camera
    assert isinstance(camera, CylindricalCamera)
    (above, middle, below) = camera.directions(np.array([[60.0, 11.0], [60.0, 12.0], [60.0, 13.0]]))
    assert middle == pytest.approx([1, 0, 0], abs=1e-9)
    aside = camera.directions(np.array([61.0, 12.0]))
    assert np.arctan2(above[2], above[0]) == pytest.approx(-np.arctan2(below[2], below[0]))
    assert abs(np.arctan2(aside[1], aside[0])) == pytest.approx(above[2] / above[0], rel=1e-3)
    assert aside[1] < 0


@pytest.mark.parametrize(("mirrored", "turned_deg", "yaw_deg", "bearing_deg"), [
    (False, 0, 0, 40), (False, 90, 0, 40), (False, -30, 75, 200), (True, 180, 0, 40), (True, 330, -60, 310),
])  # fmt: skip
def test_a_bright_spot_is_seen_where_it_is(tmp_path, mirrored, turned_deg, yaw_deg, bearing_deg):
    # of flipped pictures image right becomes image left, as with every camera: what was in front is at 180 degrees
    azimuth = np.deg2rad(bearing_deg - yaw_deg + turned_deg - 180 * mirrored)
    image = np.full((90, 180), 60, np.uint8)
    u = round(np.mod(np.pi - azimuth, 2 * np.pi) / (2 * np.pi) * 180)  # the middle is the front, left is left
    cv2.circle(image, (u, 45), 2, 255, -1)
    write(tmp_path, [image[:, ::-1] if mirrored else image])
    (tmp_path / "positions.csv").write_text(f"image,x_m,y_m,yaw_deg\n0.png,0,0,{yaw_deg}\n")
    sensor = Folder(tmp_path, panorama="equirectangular", mirrored=mirrored, turned_deg=turned_deg)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    columns = panorama(frames.images, frames.camera, (64, 720))[0].sum(0, dtype=float)
    columns -= np.median(columns)
    seen = np.angle((columns * np.exp(2j * np.pi * np.arange(720) / 720)).sum())
    bearing = seen + heading_of(frames.T_world_camera[0])
    assert abs(np.rad2deg(wrap_angle(bearing - np.deg2rad(bearing_deg)))) < 2.5


def test_it_is_a_setting_by_name(tmp_path):
    root = write(tmp_path, [np.full((64, 128), 90, np.uint8)])
    node = OmegaConf.merge(OmegaConf.structured(Folder), OmegaConf.from_dotlist([f"path={root}", "panorama=strip"]))
    assert OmegaConf.to_object(node).panorama is Panorama.strip
    with pytest.raises(
        ConfigError, match=r"panorama='sphere' is none that is read; give one of equirectangular, strip"
    ):
        Folder(root, panorama="sphere")


# -------------------------------------------------------------------------------------------------------- conflicts
def test_what_it_cannot_be_given_with(tmp_path):
    root = write(tmp_path, [np.full((64, 128), 90, np.uint8)])
    for other in ({"circle_px": [64, 32, 30]}, {"sky_inside": True}):
        with pytest.raises(ConfigError, match=r"panorama=strip has no circle and knows its horizon; leave them out"):
            read_all(Folder(root, panorama="strip", **other))
    with pytest.raises(ConfigError, match=r"blank_outside=true, but this camera has no image circle"):
        read_all(Folder(root, panorama="strip", blank_outside=True))
    save_camera(EquirectangularCamera(128, 64, 180, True), str(root / "camera.json"))  # a text will do
    assert load_camera(str(root / "camera.json")) == EquirectangularCamera(128, 64, 180, True)
    with pytest.raises(
        ConfigError, match=r"panorama=strip is given, but .*camera\.json says what camera it is; leave one"
    ):
        read_all(Folder(root, panorama="strip"))


def test_what_is_too_high_for_a_sphere(tmp_path):
    root = write(tmp_path, [np.full((80, 120), 90, np.uint8)])
    with pytest.raises(DataError, match=r"120 x 80 pixels are higher than half their width, and a sphere"):
        read_all(Folder(root, panorama="equirectangular"))


def test_what_is_too_high_for_a_strip(tmp_path):
    with pytest.raises(DataError, match=r"80 x 80 pixels are no strip around 360 degrees, which is wider than high"):
        read_all(Folder(write(tmp_path, [np.full((80, 80), 90, np.uint8)]), panorama="strip"))


def test_a_panorama_that_does_not_close_is_a_question(tmp_path, findings):
    camera = CylindricalCamera(480, 50, 180, True, -33, 33)
    root = write(tmp_path, [half(world(camera, i)) for i in range(4)])
    assert "do not continue at their left: are they panoramas over 360 degrees?" in findings(
        root, "--panorama", "strip"
    )
    root = write(tmp_path, [world(CylindricalCamera(240, 50, 180, True, -33, 33), i) for i in range(4)])
    assert "do not continue" not in findings(root, "--panorama", "strip")
    root = write(tmp_path, [np.full((50, 240), 90 + i, np.uint8) for i in range(4)])  # cannot tell
    assert "do not continue" not in findings(root, "--panorama", "strip")


# -------------------------------------------------------------------------------------------------------- proposals
def test_panoramas_taken_for_mirrors_are_proposed_to_be_what_they_are(tmp_path, caplog, findings):
    camera = EquirectangularCamera(256, 128, 180, True)
    write(tmp_path, [world(camera, phase_deg=5 * i) for i in range(6)])
    read_all(Folder(tmp_path))
    (sentence,) = warnings_of(caplog)
    proposal = "the pictures are 2:1 and their right edge continues at the left, as equirectangular panoramas are: give sensor.panorama=equirectangular"
    assert proposal in sentence
    text = findings(tmp_path)
    assert proposal in text
    assert "as with --panorama equirectangular" in text
    assert "look   panorama" in text
    assert "elevations from -90 to 90 degrees" in text
    caplog.clear()
    sensor = Folder(tmp_path, panorama="equirectangular")  # what both propose
    read_all(sensor)
    assert sensor.optics.camera == camera
    assert warnings_of(caplog) == []
    assert "panorama=equirectangular" not in findings(tmp_path, "--panorama", "equirectangular")


def test_strips_are_proposed_with_the_field_they_are_taken_to_have(tmp_path, caplog, findings):
    write(tmp_path, [world(CylindricalCamera(240, 50, 180, True, -33, 33), phase_deg=5 * i) for i in range(6)])
    read_all(Folder(tmp_path))
    assert (
        "give sensor.panorama=strip (elevations from -33 to 33 degrees; others: camera.json)" in warnings_of(caplog)[0]
    )
    assert "they are checked as panoramas, as with --panorama strip" in findings(tmp_path)


def half(image):
    """What is no panorama: its edges have nothing to do with one another."""
    return np.ascontiguousarray(image[:, : image.shape[1] // 2])


def test_what_is_two_to_one_by_chance_is_a_question(tmp_path, findings):
    camera = EquirectangularCamera(512, 128, 180, True, -45, 45)
    write(tmp_path, [half(world(camera, i)) for i in range(6)])
    text = findings(tmp_path)
    assert "?      panorama" in text.replace("?    panorama", "?      panorama")
    assert "continues at the left" not in text
    assert "give sensor.panorama=equirectangular" in text
    assert "cannot tell, as the circle is not known" in text


@pytest.mark.parametrize("shape", [(96, 96), (96, 128), (128, 96), (100, 160)])
def test_no_panorama_is_proposed_for_other_shapes(tmp_path, findings, caplog, shape):
    camera = EquirectangularCamera(2 * shape[1], shape[0], 180, True, -45, 45)
    write(tmp_path, [half(world(camera, i)) for i in range(4)])
    read_all(Folder(tmp_path))
    assert not any("sensor.panorama" in text for text in warnings_of(caplog))
    assert any("inscribed in the frame is a guess" in text for text in warnings_of(caplog)) == (shape[0] != shape[1])
    assert "sensor.panorama" not in findings(tmp_path)


def test_a_mirror_in_a_wide_dark_frame_is_no_panorama(tmp_path, caplog, findings):
    v, u = np.indices((100, 200))
    inside = np.hypot(u - 100, v - 50) <= 40
    camera = EquirectangularCamera(200, 100, 180, True)
    write(tmp_path, [np.where(inside, world(camera, i), 3).astype(np.uint8) for i in range(6)])
    assert Folder(tmp_path).optics.camera.circle.radius == pytest.approx(40, abs=1.5)
    read_all(Folder(tmp_path))
    assert warnings_of(caplog) == []
    assert "sensor.panorama" not in findings(tmp_path)


def test_two_fisheyes_side_by_side_are_no_panorama(tmp_path):
    """As 360-degree cameras keep them before stitching; what is said must not claim that they close."""
    v, u = np.indices((100, 200))
    inside = np.minimum(np.hypot(u - 49.5, v - 49.5), np.hypot(u - 149.5, v - 49.5)) <= 48
    write(tmp_path, [np.where(inside, world(EquirectangularCamera(200, 100), i), 3).astype(np.uint8) for i in range(6)])
    advice = r"show two circles, .* give sensor\.panorama=dual_fisheye, or sensor\.circle_px=\[cx,cy,radius\] of one"
    with pytest.raises(DataError, match=advice) as refused:
        read_all(Folder(tmp_path))
    assert "continues at the left" not in str(refused.value)
    read_all(Folder(tmp_path, circle_px=[49.5, 49.5, 48]))  # what it proposes
    read_all(Folder(tmp_path, panorama="dual_fisheye"))


def test_a_camera_that_says_so_is_believed(tmp_path, caplog):
    image = half(world(EquirectangularCamera(512, 128, 180, True, -45, 45)))
    data = cv2.imencode(".jpg", image)[1].tobytes()
    xmp = b'http://ns.adobe.com/xap/1.0/\0<x GPano:ProjectionType="equirectangular"/>'
    (tmp_path / "0.jpg").write_bytes(data[:2] + b"\xff\xe1" + (len(xmp) + 2).to_bytes(2, "big") + xmp + data[2:])
    read_all(Folder(tmp_path))
    assert "give sensor.panorama=equirectangular" in warnings_of(caplog)[0]


# ------------------------------------------------------------------------------------------------ published strips
MOELLER, QUORUM = CylindricalCamera(561, 81, 180, True, -24, 24), CylindricalCamera(256, 64, 180, True, -38, 38)


def noisy(image):
    noise = np.random.default_rng(int(image.sum())).normal(0, 15, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def banded(image):
    """As unwrapped mirrors often are: nothing above the rim, nothing below the camera."""
    return np.pad(image[6:-6], ((6, 6), (0, 0)))


def vignetted(image):
    (v, u), (h, w) = np.indices(image.shape), image.shape
    off = np.hypot((u - (w - 1) / 2) / (w / 2), (v - (h - 1) / 2) / (h / 2))
    return (image * np.clip(1.5 - off, 0, 1)).astype(np.uint8)


def names_of_a_grid(folder, images):
    for i, image in enumerate(images):
        assert cv2.imwrite(str(folder / f"{i // 3}_{i % 3}.png"), image)
    return folder


@pytest.mark.parametrize("spoilt", [np.asarray, noisy, banded, vignetted])
@pytest.mark.parametrize("camera", [MOELLER, QUORUM])
def test_strips_are_recognised_in_noise_bands_and_vignettes(tmp_path, findings, camera, spoilt):
    root = write(tmp_path, [spoilt(world(camera, i)) for i in range(6)])
    try:
        said = Folder(root).remarks["panorama"]
    except DataError as error:
        said = str(error)
    assert "their right edge continues at the left, as panoramic strips are: give sensor.panorama=strip" in said
    assert "they are checked as panoramas, as with --panorama strip" in findings(root)


def test_a_lit_circle_by_chance_makes_no_mirror_of_a_strip(tmp_path, caplog):
    v, u = np.indices((81, 561))
    lit = np.hypot(u - 280, v - 40) <= 37  # at night, say: nothing tells whether the edges continue
    write(tmp_path, [np.where(lit, world(MOELLER, i), 3).astype(np.uint8) for i in range(3)])
    assert Folder(tmp_path).optics.camera.circle.radius == pytest.approx(37, abs=1.5)
    read_all(Folder(tmp_path))
    assert "the pictures are 6.93:1, as panoramic strips are: give sensor.panorama=strip" in warnings_of(caplog)[0]


@pytest.mark.parametrize(
    ("preset", "camera", "more"), [("moeller", MOELLER, {"spacing_m": 0.3}), ("quorum_v", QUORUM, {})]
)
def test_presets_of_strips_attach_the_camera(tmp_path, caplog, findings, preset, camera, more):
    root = names_of_a_grid(tmp_path, [world(camera, i) for i in range(9)])
    sensor = Folder(root, names=preset, **more)
    read_all(sensor)
    found = sensor.optics.camera
    assert (type(found), found.start_deg, found.clockwise) == (CylindricalCamera, 180, True)
    assert found.highest_deg == pytest.approx(-found.lowest_deg)
    assert found.highest_deg == pytest.approx(np.rad2deg(np.arctan(np.pi * camera.height / camera.width)))
    assert warnings_of(caplog) == []
    text = findings(root, "--names", preset, *(["--spacing", "0.3"] if more else []))
    assert "CylindricalCamera; a panorama, without circle" in text
    assert "sensor.panorama" not in text


def test_a_preset_gives_way_to_a_calibration_a_circle_and_another_panorama(tmp_path):
    root = names_of_a_grid(tmp_path, [world(QUORUM, i) for i in range(4)])
    assert isinstance(Folder(root, names="quorum_v", panorama="equirectangular").optics.camera, EquirectangularCamera)
    assert Folder(root, names="quorum_v", circle_px=[100, 30, 20]).optics.camera.circle.radius == 20
    save_camera(EquirectangularCamera(256, 64, 0, False, -10, 35), root / "camera.json")
    assert Folder(root, names="quorum_v").optics.camera.start_deg == 0


def test_mirror_pictures_under_the_preset_of_a_set_of_strips_stay_mirror_pictures(tmp_path, caplog):
    root = names_of_a_grid(tmp_path, [world(HyperbolicMirror(), i) for i in range(4)])
    sensor = Folder(root, names="quorum_v")
    read_all(sensor)
    assert sensor.optics.camera.circle.radius == 125
    (sentence,) = warnings_of(caplog)
    assert "names=quorum_v is of panoramic strips as published, but the pictures are 250 x 250 pixels" in sentence


def test_a_circle_given_for_strips_is_asked_about(tmp_path, caplog):
    read_all(Folder(write(tmp_path, [world(QUORUM, i) for i in range(4)]), circle_px=[128, 32, 32]))
    assert "give sensor.panorama=strip" in warnings_of(caplog)[0]


# ------------------------------------------------------------------------------------- mirrors declared as panoramas
def in_dark_frame(image, width):
    """The round picture (H, H) of a mirror in the middle of a wider, dark frame."""
    size = len(image)
    v, u = np.indices((size, width))
    inside = np.hypot(u - (width - 1) / 2, v - (size - 1) / 2) <= 0.46 * size
    at = (width - size) // 2
    return np.where(inside, np.pad(image, ((0, 0), (at, width - size - at))), 4).astype(np.uint8)


@pytest.mark.parametrize("count", [1, 5])
def test_mirrors_declared_as_panoramas_are_told_from_them(tmp_path, caplog, findings, count):
    write(tmp_path, [in_dark_frame(world(HyperbolicMirror(), i), 340) for i in range(count)])
    read_all(Folder(tmp_path, panorama="strip"))
    (sentence,) = warnings_of(caplog)
    assert re.search(r"show a circle in a dark surround \(centre 1(69|70), 12[45], radius 11[45]\)", sentence)
    assert "If so, leave out sensor.panorama" in sentence
    assert "show a circle in a dark surround" in findings(tmp_path, "--panorama", "strip")
    caplog.clear()
    read_all(Folder(tmp_path))  # what it proposes
    assert warnings_of(caplog) == []
    assert "sensor.panorama" not in findings(tmp_path)


def test_a_run_says_that_declared_panoramas_do_not_close(tmp_path, caplog):
    mirrors = [world(HyperbolicMirror(), i)[62:187] for i in range(6)]  # 2:1, the world up to every edge
    read_all(Folder(write(tmp_path, mirrors), panorama="equirectangular"))
    assert (
        "do not continue at their left: are they panoramas over 360 degrees? If not, leave out"
        in warnings_of(caplog)[0]
    )
    read_all(Folder(tmp_path))
    assert "2:1, but their right edge does not continue at the left" in warnings_of(caplog)[1]


@pytest.mark.parametrize("aspect", [1.0, 0.75, 0.5625])
@pytest.mark.parametrize("crop", [0.5, 1.0])
def test_no_mirror_picture_is_called_a_strip(tmp_path, caplog, crop, aspect):
    camera = HyperbolicMirror(crop=crop)
    cut = round(125 * (1 - aspect))
    write(tmp_path, [noisy(world(camera, i))[cut : 250 - cut] for i in range(6)])
    read_all(Folder(tmp_path))
    assert not any("sensor.panorama" in text for text in warnings_of(caplog))


# -------------------------------------------------------------------------------------------------- mirror pictures
@pytest.mark.parametrize(
    "camera",
    [EquirectangularCamera(720, 360, 180, True), CylindricalCamera(720, 300, 90, False, -60, 40)],
)
def test_a_panorama_has_the_mirror_view_that_a_mirror_would_have_taken(camera):
    mirror = HyperbolicMirror()
    seen = mirror_view(world(camera)[None], camera)[0]
    assert seen.shape == (250, 250)
    lowest, highest = camera.elevations_rad
    v, u = np.indices((250, 250))
    z = mirror.directions(np.stack([u, v], -1).astype(float))[..., 2]
    shown = (z > np.sin(lowest + 0.03)) & (z < np.sin(min(highest, mirror.highest_rad) - 0.03))
    assert np.abs(seen.astype(int) - world(mirror))[shown].mean() < 2
    assert shown.mean() > 0.4
    assert np.array_equal(mirror_view(np.dstack([world(camera)] * 3)[None], camera)[0][..., 1], seen)


def test_a_panorama_of_what_is_above_fills_the_mirror():
    camera = EquirectangularCamera(720, 150, 180, True, -15, 60)
    assert (mirror_view(world(camera)[None], camera) > 0).mean() > 0.5
