"""Draws docs/gallery.md, every study small: its command, its recording in the viewer, its figures.

uv run python docs/study_pictures.py [STUDY ...]; about ten minutes on two cores. Runs and pictures that are there are kept,
so that it goes on where it was ended; --again makes them anew, --pages DIR and --runs DIR put them elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2

from omnilab.api import Bytes
from omnilab.runner.registry import discover

DOCS = Path(__file__).parent
RUNS = Path("logs/gallery")
WIDTH, FIGURE_WIDTH = 1200, 720  # pixels at most
ABREAST = 3  # figures in a row
MOST_BYTES = 120_000  # of a picture
SMALL = "sensor.size=128 sensor.samples=1"
CAMERA = "sensor.size=480 sensor.margin_px=80"  # half the camera of Eizoh's mirror, and the whole of its view
SHOWN = {  # by family and study: the command of a small run
    "Localisation": {
        "grid": "experiment=quickstart study.step_m=0.5 study.query_count=80 study.show=20",
        "map": "experiment=map study.step_m=0.5",
        "localize": f"experiment=localize map={RUNS}/map study.query_count=80 study.show=20",
        "live_localize": f"experiment=live_localize map={RUNS}/map sensor=mirror study.images=path study.path=square study.pace=fast",
        "route_localization": f"experiment=route_localization {SMALL} ~descriptors.gist ~descriptors.tiny_image ~localizers.hierarchical"
        " ~localizers.bayes_filter ~localizers.interpolated",
        "catchment": f"experiment=catchment {SMALL} study.references=9 study.extent_m=[4,3] ~descriptors.hog",
        "steps": f"experiment=steps {SMALL} study.steps_m=[0.4,0.8,1.2] study.query_count=30 ~descriptors.poc ~distances.poc",
        "changes": f"experiment=changes {SMALL} study.step_m=0.6 study.query_count=40 ~descriptors.poc ~distances.poc",
        "lifelong_map": f"experiment=lifelong_map {SMALL} study.step_m=0.6 study.query_count=40"
        " study.days=[unchanged,dusk,moved_dusk,moved,lamp_off,unchanged]",
        "large_map": "experiment=large_map study.steps_m=[0.8,0.4,0.2] study.query_count=60",
    },
    "Descriptors": {
        "linearity": f"experiment=linearity {SMALL} study.step_m=0.2 study.reach_m=1.6 study.references=6 study.show=10"
        " ~descriptors.radon_gist ~descriptors.fourier_signature_4 ~descriptors.gist_4 ~descriptors.rotational_pca"
        " ~descriptors.rotational_pca_complex ~distances.log ~distances.root ~distances.weighted ~distances.poc_squared",
        "cost": f"experiment=cost {SMALL} study.step_m=0.8 study.query_count=40 study.repeats=1",
        "parameter_curves": f"experiment=parameter_curves {SMALL} study.step_m=0.8 study.query_count=40 study.references=6"
        " study.line_step_m=0.2 study.repeats=1",
        "robustness": f"experiment=robustness {SMALL} study.side=6 study.step_m=0.4 study.query_count=40 ~descriptors.sift",
        "resolution": "experiment=resolution sensor.size=250 study.side=6 study.step_m=0.4 study.query_count=20 ~distances.poc",
        "rotations": "experiment=rotations sensor.width=256 sensor.height=128 sensor.samples=1 study.pairs=4 study.step_m=0.5"
        " study.distances_m=[0.0,0.5,1.0] study.show=10",
    },
    "Local and topological maps": {
        "local_map": f"experiment=local_map {SMALL} study.steps_m=[0.4] study.neighbours=[9] study.query_count=10 study.starts=5"
        " ~distances.poc ~descriptors.radon_gist ~distances.cityblock",
        "room": f"experiment=room {SMALL} study.steps_m=[0.3] study.side=6 study.starts=5 ~descriptors.poc ~distances.poc",
        "topological_map": f"experiment=topological_map {SMALL} study.steps_m=[0.5] study.nodes=[12,8] study.show=10"
        " ~descriptors.hog ~distances.cityblock",
    },
    "Altitude": {
        "altitude": "experiment=altitude sensor.samples=1 study.position_count=3 ~altimeters.sift ~altimeters.surf",
        "joint": "experiment=joint sensor.samples=1 study.step_m=0.6 study.query_count=15",
    },
    "Trajectories and SLAM": {
        "pose_graph": "experiment=pose_graph",
        "trajectory": f"experiment=square {CAMERA}",
        "view_slam": "experiment=view_slam sensor.world=room sensor.samples=1 study.path=square study.every_m=0.15 study.every_rad=0.15",
        "view_density": "experiment=view_density sensor.samples=1 study.every_m=0.2 study.every_rad=0.2 study.seeds=2 study.references=3"
        " study.compared=20 ~odometries.upright",
        "view_range": "experiment=view_range study.ranges_m=[2,4,6,8] study.seeds=4 study.fewer_seeds.view_graph=2 study.drives.laps=2",
        "view_count": "experiment=view_count study.counts=[2,8,32] study.seeds=4 study.fewer_seeds.view_graph=2 study.drives.laps=2",
        "matching": f"experiment=matching {CAMERA} study.pairs=4 study.images=120",
    },
    "Data sets": {
        "render": "experiment=render study.folder=logs/gallery/data study.layout=path study.path=square study.show=20 sensor.samples=4",
        "views": "experiment=figure_3_13",
    },
}  # fmt: skip


def main() -> None:
    """Run, draw, write the page."""
    options = _options()
    shown = {study: command for studies in SHOWN.values() for study, command in studies.items()}
    chosen = {name: command for name, command in shown.items() if name in options.study or not options.study}
    options.gallery.mkdir(parents=True, exist_ok=True)
    for study, command in chosen.items():
        folder = _run(study, command, options.again)
        _draw(study, folder, options.gallery, options.again)
    page(options.gallery)


def page(gallery: Path) -> None:
    """The page beside the pictures, of the studies that have some."""
    studies, known = discover(""), [study for commands in SHOWN.values() for study in commands]
    drawn = {study for study in known if (gallery / f"{study}.jpg").exists()}
    families = [
        f"| {family} | {' '.join(_link(study) for study in SHOWN[family] if study in drawn)} |" for family in SHOWN
    ]
    lines = ["# Gallery of studies", "", INTRODUCTION.strip(), "", "| | studies |", "|---|---|", *families]
    for study, command in (item for commands in SHOWN.values() for item in commands.items() if item[0] in drawn):
        lines += ["", f"## {study}", "", f"{studies.get('study', study).summary}", "", f"`omnilab {command}`", ""]
        lines += [f"![The recording of {study} in the viewer]({gallery.name}/{study}.jpg)"]
        figures = [f"![{_name(file)}]({gallery.name}/{file.name})" for file in sorted(gallery.glob(f"{study}-*.jpg"))]
        for first in range(0, len(figures), ABREAST):
            row = figures[first : first + ABREAST]
            lines += ["", "|" + " |" * len(row), "|" + "---|" * len(row), f"| {' | '.join(row)} |"]
    gallery.with_suffix(".md").write_text("\n".join(lines) + "\n", encoding="utf-8")


INTRODUCTION = """
Every study once, as the Rerun viewer shows its recording (`omnilab view RUN --screenshot FILE.png`) and with the figures of
its run's folder. The runs are small, so that the page is made in minutes by `uv run python docs/study_pictures.py`; the
recipes as they are take more places and queries. What virtual worlds and cameras look like: [worlds](worlds.md),
[cameras](cameras.md); what descriptors see: [descriptors](descriptors.md); the web page: [service](service.md).
"""


def _run(study: str, command: str, again: bool) -> Path:
    """The folder of the study's run, made if it is not there."""
    folder = RUNS / study
    if again or not _done(folder):
        for old in (folder, *([RUNS / "data"] if study == "render" else [])):
            if (folder / "manifest.json").exists() or old != folder:
                shutil.rmtree(old, ignore_errors=True)
        _omnilab(*shlex.split(command), f"hydra.run.dir={folder}")
    return folder


def _done(folder: Path) -> bool:
    status = folder / "status.json"
    return status.exists() and json.loads(status.read_text())["status"] == "done"


def _draw(study: str, folder: Path, gallery: Path, again: bool) -> None:
    """The recording as the viewer shows it, and the figures."""
    if again or not (gallery / f"{study}.jpg").exists():
        with tempfile.TemporaryDirectory() as temporary:
            seen = Path(temporary) / "view.png"
            _omnilab("view", str(folder), "--screenshot", str(seen))
            _save(gallery / f"{study}.jpg", seen, WIDTH)
    for figure in folder.glob("*.png"):
        if again or not (gallery / f"{study}-{figure.stem}.jpg").exists():
            _save(gallery / f"{study}-{figure.stem}.jpg", figure, FIGURE_WIDTH)


def _save(file: Path, picture: Path, width: int) -> None:
    """A JPEG of at most so many pixels and bytes."""
    image = cv2.imread(str(picture))
    if image is None:
        sys.exit(f"{picture} is no picture")
    if (scale := width / image.shape[1]) < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    for quality in range(77, 20, -8):
        encoded: Bytes = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        if len(encoded) <= MOST_BYTES:
            break
    file.write_bytes(encoded.tobytes())


def _omnilab(*words: str) -> None:
    sys.stderr.write(f"omnilab {shlex.join(words)}\n")
    subprocess.run([sys.executable, "-m", "omnilab", *words], check=True, env=os.environ | {"OMP_NUM_THREADS": "1"})


def _link(study: str) -> str:
    return f"[`{study}`](#{study})"


def _name(figure: Path) -> str:
    return figure.stem.split("-", 1)[1].replace("_", " ")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = [study for studies in SHOWN.values() for study in studies]
    parser.add_argument("study", nargs="*", help=f"of {', '.join(known)} (default: all)")
    parser.add_argument(
        "--gallery", type=Path, default=DOCS / "gallery", help="folder of the pictures; the page lies beside"
    )
    parser.add_argument("--again", action="store_true", help="run and draw also what is there")
    options = parser.parse_args()
    if unknown := sorted(set(options.study) - set(known)):
        parser.error(f"{', '.join(unknown)} is none of {', '.join(known)}")
    return options


if __name__ == "__main__":
    main()
