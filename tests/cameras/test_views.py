"""Every kind of camera beside every view: the picture of what a view looks at, painted by its direction in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Circle
from omnilab.cameras import (
    THESIS_HALF,
    THESIS_WHOLE,
    BrownConradyCamera,
    ConicalMirror,
    CylindricalCamera,
    DualFisheyeCamera,
    EllipticMirror,
    EquirectangularCamera,
    FisheyeCamera,
    HyperbolicMirror,
    ImageCircle,
    KannalaBrandtCamera,
    OCamCamera,
    ParabolicMirror,
    PinholeCamera,
    SphericalMirror,
    StereoCamera,
    UnifiedCamera,
)
from omnilab.cameras.base import PanoramaCamera, looking, not_too_steep
from omnilab.cameras.sphere import sphere_rows
from omnilab.errors import DataError
from omnilab.image import PANORAMA_SHAPE, panorama, view_of

FRAME = {"width": 320, "height": 300, "cx": 161.0, "cy": 148.0}
AHEAD = {"width": 240, "height": 200, "cx": 121.0, "cy": 98.0, "looks": "ahead"}
OWN = {  # cameras around a vertical axis: their mirror view is their own picture
    "hyperbolic": HyperbolicMirror(300, crop=1.0),
    "parabolic": ParabolicMirror(280),
    "spherical": SphericalMirror(280),
    "elliptic": EllipticMirror(280),
    "conical": ConicalMirror(280),
    "unified": UnifiedCamera(**FRAME, fx=180, fy=180, xi=0.97, rim_px=140),
    "ocam": OCamCamera(**FRAME, polynomial=(-80.0, 0.0, 0.004), rim_px=140),
    "fisheye_down": FisheyeCamera(**FRAME, focal_px=80, rim_px=140),
    "fisheye_up": FisheyeCamera(**FRAME, focal_px=80, rim_px=140, looks="up"),
    "kannala_brandt": KannalaBrandtCamera(**FRAME, fx=82, fy=82, k1=0.01, rim_px=140),
}
REPROJECTED = {  # panoramas, and cameras that look ahead
    "equirectangular": EquirectangularCamera(512, 256, 180, True),
    "equirectangular_large": EquirectangularCamera(1280, 640, 37, False),
    "equirectangular_part": EquirectangularCamera(600, 150, 180, True, -30, 15),
    "cylindrical": CylindricalCamera(512, 128, 180, True, -38, 38),
    "cylindrical_above": CylindricalCamera(512, 128, 0, False, -10, 60),
    "fisheye_ahead": FisheyeCamera(**AHEAD, focal_px=70),
    "kannala_brandt_ahead": KannalaBrandtCamera(**AHEAD, fx=82, fy=82, k1=0.01),
    "pinhole": PinholeCamera(**AHEAD, focal_px=90),
    "brown_conrady": BrownConradyCamera(**AHEAD, fx=110, fy=110, k1=-0.05),
    "dual_fisheye": DualFisheyeCamera(
        width=512, height=256, front_px=(127.5, 127.5, 126.0), back_px=(383.5, 127.5, 126.0)
    ),
    "stereo": StereoCamera(width=480, height=200, focal_px=90, baseline_m=0.1),
}
CAMERAS = OWN | REPROJECTED
NEAR = 4  # pixels of a view from where what the camera shows ends


def grid_of(camera):
    v, u = np.indices((camera.height, camera.width)).astype(float)
    return np.stack([u, v], -1)


def painted(directions):
    """Grey levels 30 to 230, smooth over directions (..., 3); 0 where there is none."""
    x, y, z = np.moveaxis(directions, -1, 0)
    levels = 130 + 35 * np.sin(2 * x + 1) + 35 * np.cos(3 * y) + 30 * np.sin(2.5 * z)
    return np.nan_to_num(np.rint(levels)).astype(np.uint8)


def shown(camera, directions, edge_px):
    """Which directions (..., 3) a camera shows; `edge_px` beyond the centres of the outer pixels of its frame, too."""
    pixels = camera.pixels(np.where(np.isfinite(directions), directions, 1.0))
    with np.errstate(invalid="ignore"):
        inside = (pixels >= -edge_px) & (pixels <= np.array([camera.width, camera.height]) - 1 + edge_px)
    inside[..., 0] |= isinstance(camera, PanoramaCamera)  # which goes around
    return inside.all(-1) & np.isfinite(directions).all(-1)


def within(mask):
    """The part of a mask (H, W) that lies some pixels within it and the view."""
    deep = np.pad(mask, ((NEAR, NEAR), (0, 0)))
    for axis in (0, 1):
        deep = np.all([np.roll(deep, by, axis) for by in range(-NEAR, NEAR + 1)], axis=0)
    return deep[NEAR:-NEAR]


def compare(found, directions, camera):
    """What is shown is as it was painted; the pixels that show something that the camera does not."""
    seen = within(shown(camera, directions, 0))
    assert seen.mean() > 0.01
    assert np.abs(found.astype(int) - painted(directions))[seen].max() <= 3
    return found[within(~shown(camera, directions, 0.5))]


def picture_of(camera):
    return painted(camera.directions(grid_of(camera)))[None]


@pytest.mark.parametrize("name", OWN)
def test_the_mirror_view_of_a_camera_around_the_vertical_is_its_own_picture(name):
    camera = OWN[name]
    picture = np.random.default_rng(3).integers(0, 256, (1, camera.height, camera.width), np.uint8)
    (view,) = view_of(picture, camera, "mirror", False)
    half = min(camera.circle.radius, camera.cx + 0.5 if hasattr(camera, "cx") else camera.size / 2)
    left, top = (round(at + 0.5 - len(view) / 2) for at in (camera.circle.cx, camera.circle.cy))
    assert abs(len(view) - 2 * half) <= 2
    assert np.array_equal(view, picture[0, top : top + len(view), left : left + len(view)])


@pytest.mark.parametrize("name", REPROJECTED)
def test_the_mirror_view_of_other_cameras_is_what_a_mirror_in_their_place_shows(name):
    camera = REPROJECTED[name]
    mirror = THESIS_WHOLE if name == "cylindrical_above" else THESIS_HALF
    (view,) = view_of(picture_of(camera), camera, "mirror", False)
    assert not compare(view, mirror.directions(grid_of(mirror)), camera).any()


@pytest.mark.parametrize("name", CAMERAS)
def test_the_panorama_of_every_camera_looks_to_its_azimuths_and_elevations(name):
    camera, (rows, columns) = CAMERAS[name], PANORAMA_SHAPE
    lowest, highest = not_too_steep(*camera.elevations_rad)
    elevation = lowest + (1 - (np.arange(rows) + 0.5) / rows) * (highest - lowest)
    directions = looking(2 * np.pi * np.arange(columns)[None] / columns, elevation[:, None])
    (view,) = view_of(picture_of(camera), camera, "panorama", False)
    assert not compare(view, directions, camera).any()


@pytest.mark.parametrize("name", CAMERAS)
def test_the_sphere_of_every_camera_is_what_a_360_degree_camera_in_its_place_shows(name):
    camera = CAMERAS[name]
    rows = sphere_rows(camera)
    whole = EquirectangularCamera(2 * rows, rows)
    (view,) = view_of(picture_of(camera), camera, "sphere", False)
    assert not compare(view, whole.directions(grid_of(whole)), camera).any()


def test_a_circle_without_calibration_has_its_picture_and_panorama_but_no_sphere():
    camera = ImageCircle(120, 120, Circle(59.5, 59.5, 55))
    picture = np.full((1, 120, 120), 90, np.uint8)
    assert view_of(picture, camera, "mirror", False).shape == (1, 110, 110)
    assert (view_of(picture, camera, "panorama", False) == 90).all()
    with pytest.raises(DataError, match="give the images a calibration, or choose a descriptor whose view is 'mirror'"):
        view_of(picture, camera, "sphere", False)


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_panorama_has_no_seam(clockwise):
    """What lies between the last column and the first is interpolated between both, wherever the ends of the picture are."""
    views = []
    for start_deg in (0.0, 101.3):
        camera = EquirectangularCamera(360, 180, start_deg, clockwise)
        views.append(panorama(picture_of(camera), camera, (60, 720))[0].astype(int))
    assert np.abs(views[0] - views[1]).max() <= 2
