"""Every file format: how to make a small valid file of it, how a user has it read, and what must hold of the result."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
from fuzz_engine import confirm
from fuzz_mutations import mutated

from omnilab.api import (
    Image,
    NamedPath,
    Places,
    Pose,
    RandomPoses,
    RecordedPoses,
    Signatures,
    Text,
    Tick,
)
from omnilab.cameras import (
    CylindricalCamera,
    EquirectangularCamera,
    FisheyeCamera,
    HyperbolicMirror,
    OCamCamera,
    PinholeCamera,
    RayCamera,
    SphericalMirror,
    StereoCamera,
    UnifiedCamera,
    load_camera,
    save_camera,
)  # fmt: skip
from omnilab.geometry import planar_poses
from omnilab.posegraph.files import g2o_text, read_graph, toro_text
from omnilab.runner.map_file import about_map, load_places, save_map
from omnilab.runner.run_folder import find_runs, load_run
from omnilab.runner.terminal import headline
from omnilab.trajectory.files import kitti_text, read_trajectory, tum_text
from omnilab_appearance.descriptors.rotational_pca import RotationalPca
from omnilab_mcap import McapSink
from omnilab_mirror import Mirror
from omnilab_mirror.lint import warnings_of
from omnilab_mirror.scene.load import load_world, problems_of
from omnilab_recordings import Folder
from omnilab_rerun import RerunSink
from omnilab_slam import GtsamBatch
from omnilab_studies.pose_graph.simulated_graphs import Walk
from omnilab_studies.view_slam.drives import Drives
from omnilab_studies.view_slam.scenarios import scenario, shipped

BOX = Path(__file__).parents[1] / "box_world.yaml"


@dataclass(frozen=True)
class Format:
    """A format: the file that is mutated, how to write a folder that holds it, and how to read it."""

    file: str
    write: Callable[[Path], None]  # into an empty folder
    read: Callable[[Path], Any]  # the folder; raises Broken where the result is not sound
    mutate: Callable[[bytes, Random], bytes] = mutated

    def prepare(self, folder: Path) -> bytes:
        """Write the folder: the sound bytes of the file."""
        folder.mkdir(parents=True)
        self.write(folder)
        return (folder / self.file).read_bytes()

    def fuzz(self, folder: Path, sound: bytes, seed: str) -> None:
        """Mutate the file, as the seed says, and read it."""
        (folder / self.file).write_bytes(self.mutate(sound, Random(seed)))
        self.read(folder)


# ----------------------------------------------------------------------------------------------------------- invariants
def sound_poses(T: Any) -> None:
    """Broken unless T (N, 4, 4) are poses."""
    confirm(T is not None and T.ndim == 3 and T.shape[1:] == (4, 4), "no poses")
    confirm(np.isfinite(T).all(), "a pose is not finite")
    R = T[:, :3, :3]
    confirm(np.allclose(R @ R.swapaxes(1, 2), np.eye(3), atol=1e-6) and (np.linalg.det(R) > 0).all(), "no rotation")
    confirm((T[:, 3] == [0, 0, 0, 1]).all(), "the last row of a pose")


def sound_images(images: Any, *channels: int) -> None:
    """Broken unless these are images."""
    confirm(images.dtype == np.uint8 and images.ndim == 3 + len(channels) and min(images.shape) > 0, "no images")


def sound_camera(camera: RayCamera) -> None:
    """Broken unless a camera has unit rays where it has any, and sees them where they come from."""
    v, u = np.mgrid[: camera.height : 7j, : camera.width : 7j]
    pixels = np.stack([u, v], -1).reshape(-1, 2)
    rays = camera.directions(pixels)
    seen = np.isfinite(rays).all(axis=1)
    confirm(not np.isinf(rays).any(), "an infinite ray")
    confirm(np.allclose(np.linalg.norm(rays[seen], axis=1), 1, atol=1e-6), "a ray is no unit vector")
    confirm(all(np.isfinite(camera.elevations_rad)), "elevations are not finite")


def trajectory(name: str) -> Callable[[Path], None]:
    """Reader of a file of poses."""

    def read(folder: Path) -> None:
        found = read_trajectory(folder / name)
        sound_poses(found.T_world_camera)
        confirm(found.stamps_ns is None or len(found.stamps_ns) == len(found.T_world_camera), "stamps of other poses")

    return read


def recording(folder: Path, **settings: Any) -> None:
    """Read a folder of images as a study does."""
    sensor = Folder(str(folder), **({"circle_px": [16.0, 16.0, 15.0]} | settings))
    plan = sensor.plan(RecordedPoses())
    if plan.T_world_camera is not None:
        sound_poses(plan.T_world_camera)
    for frames in sensor.frames(plan):
        sound_images(frames.images, *frames.images.shape[3:])
        if frames.depth_m is not None:
            confirm(not (frames.depth_m < 0).any(), "a depth below 0")


def world(name: str) -> Callable[[Path], None]:
    """Reader of a world: it is built, looked over, and rendered."""

    def read(folder: Path) -> None:
        file = str(folder / name)
        built, problems = problems_of(file)
        for problem in problems:
            confirm("\n" not in str(problem), f"a problem of several lines: {problem}")
        found = load_world(file)
        confirm(built is not None, "a world that can be loaded could not be built")
        confirm(all(isinstance(warning, str) for warning in warnings_of(found)), "a warning is no sentence")
        sensor = Mirror(world=file, size=16, samples=1)
        mesh = sensor.scene()
        confirm(mesh is None or np.isfinite(mesh.vertices_m).all(), "the viewer's mesh is not finite")
        for layout in (RandomPoses(2, 0), *(NamedPath(path) for path in found.paths)):
            plan = sensor.plan(layout).at(np.arange(1))
            sound_poses(plan.T_world_camera)
            for frames in sensor.frames(plan):
                sound_images(frames.images)

    return read


def graph(folder: Path) -> None:
    """Read a pose graph, optimise it, write it and read it again."""
    found = read_graph(folder / "graph.g2o")
    confirm(
        np.isfinite(found.poses).all() and np.isfinite(found.motions).all() and np.isfinite(found.information).all(),
        "not finite",
    )
    optimum = GtsamBatch(max_iterations=5).optimize(found)
    confirm(np.isfinite(optimum.poses).all(), "the optimum is not finite")
    (folder / "again.g2o").write_text(g2o_text(found))
    again = read_graph(folder / "again.g2o")
    confirm(
        np.array_equal(again.edges, found.edges) and np.allclose(again.motions, found.motions),
        "another graph when read again",
    )


def drive(folder: Path) -> None:
    """Read a scenario and drive through it."""
    found = scenario(str(folder / "scenario.yaml"))
    confirm(np.isfinite(found.lap).all() and np.isfinite(found.walls_m).all(), "not finite")
    if len(found.lap) < 2000:
        driven = Drives(laps=1).drive(found, 3, np.random.default_rng(0))
        confirm(np.isfinite(driven.truth).all() and np.isfinite(driven.motions).all(), "the drive is not finite")


def saved_map(folder: Path) -> None:
    """Read a map."""
    about_map(folder / "map.npz")
    places = load_places(folder / "map.npz")
    confirm(
        np.isfinite(places.signatures.place).all() and len(places.keys) == len(places.signatures.place),
        "the map is not sound",
    )
    if places.T_world_camera is not None:
        sound_poses(places.T_world_camera)


def run_folder(folder: Path) -> None:
    """List, show, repeat and repair a run, as far as they only read."""
    run = load_run(folder / "run")
    with contextlib.suppress(KeyError):
        confirm(isinstance(headline(run.metrics), str), "no headline")
    confirm(all(isinstance(v, float) for v in run.metrics.values()), "a metric is no number")
    confirm(isinstance(run.state, str) and isinstance(run.manifest, dict) and isinstance(run.config, dict), "no run")
    confirm(len(find_runs(folder)) <= 1, "more runs than there are")
    _ = run.units, run.intervals, run.table("queries")


def logs(sink: Any, name: str) -> Callable[[Path], None]:
    """Mend a log; mended, it is whole."""

    def read(folder: Path) -> None:
        sink.repair(folder)
        confirm(sink.repair(folder) is None, f"{name} is not whole after it was mended")

    return read


def eigenspace(folder: Path) -> None:
    """Describe images with a basis."""
    found = RotationalPca(components=3, rotations=8, rows=8, basis=str(folder / "basis.npz"))
    place = found.describe(np.full((2, 16, 32), 100, np.uint8)).place
    confirm(place.shape == (2, 3), f"signatures of shape {place.shape}")
    confirm(np.isfinite(place).all(), "a signature is not finite")


# ---------------------------------------------------------------------------------------------------------------- seeds
def path_of(count: int) -> Any:
    """Poses (count, 4, 4) along a bent path."""
    t = np.arange(count) * 0.3
    return planar_poses(np.column_stack([t, np.sin(t), np.ones(count)]), 0.4 * t)


def pictures(folder: Path, suffix: str = "png", count: int = 3) -> None:
    rng = np.random.default_rng(1)
    for i in range(count):
        noise = cv2.GaussianBlur(rng.integers(0, 255, (32, 32, 3), np.uint8), (0, 0), 2)
        cv2.imwrite(str(folder / f"{i}.{suffix}"), noise[:, :, 0] if suffix == "pgm" else noise)


def with_table(text: str, name: str = "positions.csv") -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        pictures(folder)
        (folder / name).write_text(text)

    return write


def text_file(name: str, text: str | Callable[[], str]) -> Callable[[Path], None]:
    return lambda folder: _ignore((folder / name).write_text(text if isinstance(text, str) else text()))


def camera_file(camera: RayCamera) -> Callable[[Path], None]:
    return lambda folder: save_camera(camera, folder / "camera.json")


def _ignore(_: Any) -> None:
    """Of a writer's answer."""


def walk_graph() -> Any:
    return Walk(count=12, side=3).graph(np.random.default_rng(0))[0]


SPATIAL = "".join(f"VERTEX_SE3:QUAT {i} {i} 0 0 0 0 0 1\n" for i in range(4)) + "".join(
    f"EDGE_SE3:QUAT {i} {j} {j - i} 0.1 0 0 0 0.1 0.995 10 0 0 0 0 0 10 0 0 0 0 10 0 0 0 100 0 0 100 0 100\n"
    for i, j in [(0, 1), (1, 2), (2, 3), (0, 3)]
)

OBJ = """mtllib room.mtl
v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nv -2 -2 3\nv 2 -2 3\nv 2 2 3\nv -2 2 3
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl red\nf 1/1 2/2 3/3 4/4\nf 5/1 8/2 7/3 6/4\nusemtl picture
f 1/1 5/2 6/3 2/4\nf 2/1 6/2 7/3 3/4\nf 3/1 7/2 8/3 4/4\nf 4/1 8/2 5/3 1/4
"""
MTL = "newmtl red\nKd 0.8 0.2 0.1\nnewmtl picture\nKd 1 1 1\nmap_Kd 0.png\n"


def obj_files(folder: Path) -> None:
    pictures(folder, count=1)
    (folder / "room.obj").write_text(OBJ)
    (folder / "room.mtl").write_text(MTL)


def exported(name: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        import trimesh

        box = trimesh.creation.box((4, 4, 3))
        box.apply_translation((0, 0, 1.5))
        box.visual.vertex_colors = np.tile([200, 90, 60, 255], (8, 1))
        data = box.export(
            file_type=name.rsplit(".", maxsplit=1)[-1], **({"encoding": "ascii"} if name.startswith("ascii") else {})
        )
        (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())

    return write


def map_file(folder: Path) -> None:
    place = np.random.default_rng(0).random((4, 3, 5), np.float32)
    about = {
        "components": {"descriptor": {"name": "radon"}},
        "config": {"descriptor": {"offsets": 5}},
        "omnilab": "0.1",
    }
    save_map(folder / "map.npz", Places(Signatures(place), path_of(4), list("abcd")), about)


def run_files(folder: Path) -> None:
    run = folder / "run"
    run.mkdir()
    (run / "config.yaml").write_text("study:\n  step_m: 0.4\nsensor:\n  world: room\nseed: 0\nlogs: logs\n")
    (run / "manifest.json").write_text(
        json.dumps({"experiment": "grid", "overrides": ["seed=1"], "components": {}, "seed": 0})
    )
    (run / "status.json").write_text(json.dumps({"status": "done", "pid": 1, "sinks_dropped": []}))
    (run / "metrics.csv").write_text("metric,value,unit,low,high\nnearest_rate,0.5,,0.4,0.6\nmedian,1.25,m,,\n")
    (run / "queries.csv").write_text("key,error_m\na,0.5\n")


def log_of(sink_of: Callable[[], Any]) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        sink = sink_of()
        sink.open(folder)
        for i in range(5):
            tick = Tick(i, i * 10**8)
            sink.write("image", Image(np.full((8, 8), 40 * i, np.uint8), "png"), tick)
            sink.write("text", Text(f"step {i}"), tick)
            sink.write("pose", Pose(path_of(5)[i]), tick)
        sink.close()

    return write


def basis_file(folder: Path) -> None:
    images = np.random.default_rng(0).integers(0, 255, (5, 16, 32), np.uint8)
    RotationalPca(components=3, rotations=8, rows=8).fit(images).save(folder / "basis.npz")


def depth_folder(folder: Path) -> None:
    (folder / "images").mkdir()
    (folder / "depth").mkdir()
    for i in range(2):
        cv2.imwrite(str(folder / f"images/{i}.png"), np.full((32, 32), 90 + i, np.uint8))
        np.save(folder / f"depth/{i}.npy", np.full((32, 32), 1.5, np.float32))


ROWS = "".join(f"{i}.png,{i * 0.5},{i * 0.25},1.0,{i * 10}\n" for i in range(3))
CAMERAS: dict[str, RayCamera] = {
    "mirror": HyperbolicMirror(64, 1.0), "spherical": SphericalMirror(64), "unified": UnifiedCamera(width=64, height=64, cx=31.0, cy=31.0, looks="down", fx=30, fy=30, xi=0.9),
    "pinhole": PinholeCamera(width=64, height=48, cx=31.0, cy=23.0, looks="ahead", focal_px=40.0), "fisheye": FisheyeCamera(width=64, height=64, cx=31.0, cy=31.0, looks="up", rim_px=30.0, focal_px=20.0),
    "cylindrical": CylindricalCamera(64, 32), "equirectangular": EquirectangularCamera(64, 32), "stereo": StereoCamera(width=64, height=24, focal_px=40.0, baseline_m=0.1),
}  # fmt: skip
OCAM = """#polynomial coefficients for the DIRECT mapping function
5 -1.2e+02 0.0 1.1e-03 -2.0e-06 1.0e-08
#polynomial coefficients for the inverse mapping function
3 180.0 110.0 -5.0
#center: "row" and "column", starting from 0
120.0 121.0
#affine parameters "c", "d", "e"
1.0 0.0 0.0
#image size: "height" and "width"
240 242
"""
IMAGES = {"png": 1, "jpg": 1, "bmp": 1, "tiff": 1, "webp": 1, "pgm": 1, "ppm": 1}


def image_format(suffix: str) -> Format:
    return Format(
        f"1.{suffix}", lambda folder: pictures(folder, suffix, 2), lambda folder: recording(folder, positions=None)
    )


FORMATS: dict[str, Format] = {
    "poses_csv": Format("p.csv", text_file("p.csv", "stamp_s,x_m,y_m,z_m,yaw_deg\n" + "".join(f"{i}.5,{i},0.5,1,{i * 9}\n" for i in range(5))), trajectory("p.csv")),
    "poses_tum": Format("p.tum", text_file("p.tum", lambda: tum_text(path_of(5), np.arange(5) * 10**9)), trajectory("p.tum")),
    "poses_kitti": Format("p.kitti", text_file("p.kitti", lambda: kitti_text(path_of(5))), trajectory("p.kitti")),
    "positions_csv": Format("positions.csv", with_table(f"image,x_m,y_m,z_m,yaw_deg\n{ROWS}"), recording),
    "positions_tum": Format("p.tum", with_table(tum_text(path_of(3), np.arange(3) * 10**9), "p.tum"), lambda folder: recording(folder, positions="p.tum")),
    **{f"image_{suffix}": image_format(suffix) for suffix in IMAGES},
    "depth_npy": Format("depth/1.npy", depth_folder, lambda folder: recording(folder, positions=None, pattern="images/*", depth=True)),
    **{f"camera_{name}": Format("camera.json", camera_file(camera), lambda folder: sound_camera(load_camera(folder / "camera.json"))) for name, camera in CAMERAS.items()},
    "camera_ocam": Format("calib_results.txt", text_file("calib_results.txt", OCAM), lambda folder: sound_camera(OCamCamera.from_file(folder / "calib_results.txt", "down", None, 0.0))),
    "graph_g2o": Format("graph.g2o", text_file("graph.g2o", lambda: g2o_text(walk_graph())), graph),
    "graph_g2o_3d": Format("graph.g2o", text_file("graph.g2o", SPATIAL), graph),
    "graph_toro": Format("graph.g2o", text_file("graph.g2o", lambda: toro_text(walk_graph())), graph),
    "world_yaml": Format("world.yaml", lambda folder: _ignore((folder / "world.yaml").write_bytes(BOX.read_bytes())), world("world.yaml")),
    "mesh_obj": Format("room.obj", obj_files, world("room.obj")),
    "mesh_mtl": Format("room.mtl", obj_files, world("room.obj")),
    "mesh_texture": Format("0.png", obj_files, world("room.obj")),
    "mesh_ply": Format("box.ply", exported("box.ply"), world("box.ply")),
    "mesh_ply_ascii": Format("ascii.ply", exported("ascii.ply"), world("ascii.ply")),
    "mesh_glb": Format("box.glb", exported("box.glb"), world("box.glb")),
    "scenario_yaml": Format("scenario.yaml", lambda folder: _ignore((folder / "scenario.yaml").write_bytes(shipped()["walls"].read_bytes())), drive),
    "map_npz": Format("map.npz", map_file, saved_map),
    "basis_npz": Format("basis.npz", basis_file, eigenspace),
    **{f"run_{name.partition('.')[0]}": Format(f"run/{name}", run_files, run_folder) for name in ("config.yaml", "manifest.json", "status.json", "metrics.csv", "queries.csv")},
    "log_mcap": Format("run.mcap", log_of(McapSink), logs(McapSink(), "run.mcap")),
    "log_rrd": Format("run.rrd", log_of(RerunSink), logs(RerunSink(), "run.rrd")),
}  # fmt: skip
SLOW = {"log_rrd"}  # a process of its own for each input
