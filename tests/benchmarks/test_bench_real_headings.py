"""Headings between real panoramas, by the shipped descriptors as they are.

pytest tests/benchmarks/test_bench_real_headings.py --benchmark-enable -n 0 -s

`sussex_route` has strips of 25 x 120 pixels, 3 degrees a column, along 7.5 m outdoors; what is known of a heading is the course of
the robot's way there, itself good to some degrees. `amiens_catadioptric` has two mirror images of a laboratory, one place,
rotated by 46.5 degrees by phase correlation. A tour of ZInD has whole spheres of the rooms of one home, with poses: it lies
in ../shared/data/zind, or where OMNILAB_ZIND says (`omnilab dataset list zind`: where it is had, and its terms).
"""

import csv
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.cameras import UnifiedCamera
from omnilab.geometry import heading_of, wrap_angle
from omnilab.image import view_of
from omnilab.runner.registry import discover
from omnilab_appearance.descriptors.fourier_signature import FourierSignature
from omnilab_appearance.descriptors.gist import Gist
from omnilab_appearance.descriptors.hog import Hog
from omnilab_appearance.descriptors.spherical_harmonics import SphericalHarmonics
from omnilab_appearance.descriptors.spherical_sift import SphericalSift
from omnilab_appearance.distances.epipolar_rotation import EpipolarRotation
from omnilab_appearance.distances.so3_correlation import So3Correlation
from omnilab_recordings import Folder
from omnilab_recordings.published.conversions import prepare
from omnilab_recordings.published.published_set import published_set
from omnilab_studies.descriptors.rotations.pairs import pairs_of, rooms_of

DATA = Path(__file__).parents[2].parent / "shared/data"
ROUTE, LABORATORY = DATA / "sussex_route", DATA / "amiens_catadioptric"
TOUR = Path(os.environ.get("OMNILAB_ZIND", DATA / "zind"))
DESCRIPTORS = {"fourier_signature": FourierSignature, "gist": Gist, "hog": Hog}  # with their default distances
ERRORS = "what they look for is errors (docs/rotations.md); the descriptors stand beside their peers"
DISTANCES_M, SLACK_M, PAIRS = (0.25, 0.5, 1.0, 2.0, 3.0), 0.05, 200
TURN_DEG = -46.5  # of the laboratory's camera, from the first image to the second
CAMERA = UnifiedCamera(
    width=1600, height=1200, cx=692.86729, cy=572.11922, fx=425.19303, fy=424.86463, xi=0.98754, rim_px=495, inner_px=75
)
SPHERES = {  # of conf/experiment/recorded_headings.yaml
    "so3_correlation": (SphericalHarmonics(), So3Correlation(largest_tilt_deg=0)),
    "epipolar_rotation": (SphericalSift(), EpipolarRotation()),
    "epipolar_planar": (SphericalSift(1000, 0.005), EpipolarRotation(planar=True, draws=1000)),
}


def rotations(name, before, after, **settings):
    """Headings (N,) of panoramas after in the frame of those before, pair by pair."""
    descriptor = DESCRIPTORS[name](**settings)
    return matched(descriptor, discover("").get("distance", descriptor.default_distance).cls(), before, after)


def matched(descriptor, distance, before, after):
    """The same of pictures as the descriptor wants them, by a distance."""
    first, second = descriptor.describe(before), descriptor.describe(after)
    found = [distance.match(second[i : i + 1], distance.prepare(first[i : i + 1])) for i in range(len(before))]
    return np.array([match.rotation_rad[0, 0] for match in found])


def route():
    """Images (N, 25, 120), positions (N, 2) and courses (N,) where the robot drove."""
    with (ROUTE / "positions.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["sequence"] == "training" and row["course_deg"]]
    images = np.array(
        [cv2.imread(str(ROUTE / row["file"]), cv2.IMREAD_GRAYSCALE)[:, ::-1] for row in rows]
    )  # azimuth to the left
    position_m = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
    return images, position_m, np.deg2rad([float(row["course_deg"]) for row in rows])


@pytest.mark.skipif(not ROUTE.is_dir(), reason="needs ../shared/data/sussex_route")
@pytest.mark.parametrize("name", DESCRIPTORS)
def test_headings_along_a_route_outdoors(benchmark, name):
    images, position_m, course = route()
    apart = np.linalg.norm(position_m[:, None] - position_m, axis=2)
    rng, medians = np.random.default_rng(0), {}
    for_strips = {"rows": 25} | ({"blocks": 8} if name == "gist" else {})
    for distance_m in DISTANCES_M:
        i, j = np.nonzero(np.triu(np.abs(apart - distance_m) < SLACK_M, 1))
        chosen = rng.choice(len(i), min(PAIRS, len(i)), replace=False)
        i, j = i[chosen], j[chosen]
        found = rotations(name, images[i], images[j], **for_strips)
        turned = wrap_angle(course[j] - course[i])
        error = np.rad2deg(np.abs(wrap_angle(found - turned)))
        medians[f"{distance_m:g} m"] = tuple(
            round(float(np.median(deg)), 1) for deg in (error, np.rad2deg(np.abs(turned)))
        )

    benchmark.extra_info.update(medians, no_peer=ERRORS)
    benchmark.pedantic(rotations, (name, images[:20], images[20:40]), for_strips, rounds=3)


@pytest.mark.skipif(not LABORATORY.is_dir(), reason="needs ../shared/data/amiens_catadioptric")
@pytest.mark.parametrize("name", DESCRIPTORS)
def test_the_turn_of_a_camera_in_a_laboratory(benchmark, name):
    files = [str(LABORATORY / f"{image}.pgm") for image in ("Im_R0_T0", "Im_R45_T0")]
    images = np.array([cv2.imread(file, cv2.IMREAD_GRAYSCALE) for file in files])
    first, second = view_of(images, CAMERA, "panorama", False)[:, None]
    found = benchmark.pedantic(rotations, (name, first, second), rounds=3)
    error_deg = float(np.rad2deg(abs(wrap_angle(found[0] - np.deg2rad(TURN_DEG)))))

    benchmark.extra_info.update(error_deg=round(error_deg, 1), no_peer=ERRORS)


@pytest.mark.skipif(
    not (TOUR / "zind_data.json").is_file(), reason="needs a tour of ZInD: ../shared/data/zind or OMNILAB_ZIND"
)
@pytest.mark.parametrize("name", [*DESCRIPTORS, *SPHERES])
def test_headings_between_spheres_of_one_room(benchmark, name, tmp_path):
    prepare(published_set("zind"), TOUR, tmp_path / "tour")
    sensor = Folder(str(tmp_path / "tour/floor_01"), panorama="equirectangular")
    plan = sensor.plan(RecordedPoses())
    rooms = rooms_of(plan.keys, r"complete_room_\d+")
    before, after, _ = pairs_of(plan, [1.5], 1000, 1.5, np.random.default_rng(0), rooms, once=True)
    frames = list(sensor.frames(plan))
    view = "sphere" if name in SPHERES else "panorama"
    pictures = np.concatenate([view_of(each.images, each.camera, view, False) for each in frames])
    heading = heading_of(plan.T_world_camera)
    method = SPHERES.get(name) or (
        descriptor := DESCRIPTORS[name](), discover("").get("distance", descriptor.default_distance).cls()
    )  # fmt: skip
    found = benchmark.pedantic(matched, (*method, pictures[before], pictures[after]), rounds=1)
    error_deg = np.rad2deg(np.abs(wrap_angle(found - (heading[after] - heading[before]))))

    benchmark.extra_info.update(median_deg=round(float(np.median(error_deg)), 1), pairs=len(found), no_peer=ERRORS)
    if name == "epipolar_planar":
        assert np.median(error_deg) < 10
