"""Makes docs/real_images.md from runs on real images: uv run python docs/real_images.py [DATA] [RUNS]

DATA (../shared/data) holds the downloads sussex_route, cycloid_ceiling and bearingnet_forest_grid. Runs are kept in RUNS
(logs/real_images), and those that are there are not made again. No picture of the data goes into the page, only plots.
"""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

HERE = Path(__file__).parent
OMNILAB = [sys.executable, "-m", "omnilab"]
SETS = ("sussex_route", "cycloid_ceiling", "bearingnet_forest_grid")
STRIP = ("sensor.path={sets}/sussex/training", "sensor.panorama=strip")
TEST_A = (
    "study.queries=other", "+sensor@sensors.queries=folder", "sensors.queries.path={sets}/sussex/test_a",
    "sensors.queries.panorama=strip", "study.truth={sets}/sussex/test_a/truth.csv",
)  # fmt: skip
DISTANCES = (
    *(f"+distance@distances.{name}={name}" for name in (
        "cityblock", "euclidean", "cosine", "pearson", "circular_correlation", "poc_band", "rotational_difference")),
    "~descriptors.fourier_means", "~descriptors.gist_coarse",
    *(f"~localizers.{name}" for name in ("hierarchical", "bayes_filter", "route_filter", "sequence_matching")),
)  # fmt: skip
FOREST = (
    "sensor.path={sets}/forest", "sensor.circle_px=[512,512,455,150]", "sensor.sky_inside=true", "sensor.blank_outside=true",
    "sensor.turned_deg=180", "study.references=100",
)  # fmt: skip
ODOMETRIES = ("appearance_fit", "guided_epipolar", "planar_epipolar")
RUNS = {
    "every_17_cm": ("experiment=recorded_route", *STRIP, "study.every=10", "study.queries=midway"),
    "every_7_cm": ("experiment=recorded_route", *STRIP, "study.every=4", "study.queries=midway"),
    "test_a": ("experiment=recorded_route", *STRIP, "study.every=4", *TEST_A),
    "test_a_calibrated": (
        "experiment=recorded_route", *STRIP, "study.every=4", *TEST_A, "study.calibration=queries", "study.confidence=0.9",
    ),
    "distances_17_cm": ("experiment=recorded_route", *STRIP, "study.every=10", "study.queries=midway", *DISTANCES),
    "distances_test_a": ("experiment=recorded_route", *STRIP, "study.every=4", *TEST_A, *DISTANCES),
    "ceiling": (
        "experiment=recorded_route", "sensor.path={sets}/ceiling", "sensor.circle_px=[316,227,220]", "study.every=4",
        "study.queries=midway", "study.headings=recorded", "study.course_m=0.5",
    ),
    "virtual": ("experiment=route_localization", "study.queries=midway"),
    "catchment_drive": (
        "experiment=recorded_catchment", *STRIP, "study.images=recorded", "study.every=5", "study.course_m=0.25",
    ),
    "catchment_forest": ("experiment=recorded_catchment", *FOREST),
    "catchment_virtual": ("experiment=catchment",),
    **{f"odometry_{name}": ("experiment=recorded_trajectory", "sensor.path={sets}/odometry", "sensor.panorama=strip",
                            f"odometry={name}", "loop_closure=none") for name in ODOMETRIES},
}  # fmt: skip
BASELINES = {"every_17_cm": (0.095, 0.20), "test_a": (0.20, 0.31)}  # median and 90 %, of the set's own description
SHOWN = ("fourier_signature", "rotational_pca", "hog_grid", "hog", "tiny_image")  # of the sets of places
WORSE = 2.0  # times the steps that it takes in the virtual world: it fails on real pictures
SHINES = 2.0  # steps of the map that nine in ten answers are within
ERRORS = (
    ("median", "position_error_median_m", 100), ("90 %", "position_error_p90_m", 100), ("worst", "position_error_worst_m", 100),
    ("along", "along_error_median_m", 100), ("across", "across_error_median_m", 100), ("heading", "heading_error_median_deg", 1),
)  # fmt: skip

HEAD = (
    "# Numbers on real images\n\nMade by `uv run python docs/real_images.py`; no number is typed by hand. The set"
    " `sussex_route` is a robot's drive of 7.7 m on a square, as strips of 120 x 25 pixels, and a second, autonomous drive"
    " (test_a) of which some images have positions (`omnilab dataset list sussex_route`). Errors are in centimetres, headings"
    " in degrees against the course; `along` and `across` are medians."
)

Row = dict[str, str]


def main(argv: Sequence[str]) -> int:
    """Prepare the sets, run what is missing, write the page."""
    data = Path(argv[0] if argv else "../shared/data")
    runs = Path(argv[1] if len(argv) > 1 else "logs/real_images")
    if missing := [name for name in SETS if not (data / name).is_dir()]:
        sys.stderr.write(
            f"{data} lacks {', '.join(missing)}, so docs/real_images.md is left as it is; download them (omnilab dataset list"
            " sussex_route says where) and give DATA\n"
        )
        return 2
    prepared(data, runs / "sets")
    for name, overrides in RUNS.items():
        run(name, [each.format(sets=runs / "sets") for each in overrides], runs / name)
    (HERE / "real_images.md").write_text(page(runs))
    pictures(runs)
    return 0


def prepared(data: Path, sets: Path) -> None:
    """The sets as folders of images with positions."""
    for name, folder in (("sussex_route", "sussex"), ("bearingnet_forest", "forest")):
        source = data / ("bearingnet_forest_grid" if folder == "forest" else name)
        if not (sets / folder).is_dir():
            subprocess.run([*OMNILAB, "dataset", "prepare", name, source, sets / folder], check=True)
    if not (sets / "odometry").is_dir():
        fifth_images(sets / "sussex/training", sets / "odometry")
    if (ceiling := sets / "ceiling").is_dir():
        return
    (ceiling / "images").mkdir(parents=True)
    with (data / "cycloid_ceiling/positions.csv").open() as table:
        rows = list(csv.DictReader(table))
    for row in rows:
        shutil.copyfile(data / "cycloid_ceiling" / row["file"], ceiling / row["file"])
    lines = [f"{row['file']},{row['x_m']},{row['y_m']},{row['theta_rad']}\n" for row in rows]
    (ceiling / "positions.csv").write_text("image,x_m,y_m,yaw_rad\n" + "".join(lines))


def fifth_images(drive: Path, folder: Path) -> None:
    """Each fifth image of a drive, 9 cm apart, its heading that of the course over half a metre around it."""
    rows = [row for row in table(drive / "positions.csv") if row["x_m"]][::5]
    xy = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
    at = np.clip(np.arange(len(xy)) + np.array([[3], [-3]]), 0, len(xy) - 1)
    yaw = np.arctan2(*(xy[at[0]] - xy[at[1]]).T[::-1])
    lines = [f"{row['image']},{row['x_m']},{row['y_m']},{turn}\n" for row, turn in zip(rows, yaw, strict=True)]
    for row in rows:
        (folder / row["image"]).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(drive / row["image"], folder / row["image"])
    (folder / "positions.csv").write_text("image,x_m,y_m,yaw_rad\n" + "".join(lines))


def run(name: str, overrides: Sequence[str], folder: Path) -> None:
    """One run, unless it is there."""
    if (folder / "status.json").exists() and json.loads((folder / "status.json").read_text())["status"] == "done":
        return
    sys.stderr.write(f"{name}: omnilab {' '.join(overrides)}\n")
    shutil.rmtree(folder, ignore_errors=True)
    with (folder.parent / f"{name}.txt").open("w") as log:
        quiet = ["study.show=0"] if "route" in overrides[0] else []
        subprocess.run([*OMNILAB, *overrides, f"hydra.run.dir={folder}", *quiet], check=True, stdout=log)


def page(runs: Path) -> str:
    """The page, of nothing but what the runs measured."""
    rows = {name: table(runs / name / "route.csv") for name in RUNS if (runs / name / "route.csv").exists()}
    steps = {name: metrics(runs / name)["map_step"] for name in rows}
    parts = [
        HEAD,
        failures(rows["every_17_cm"], rows["virtual"], steps["every_17_cm"], steps["virtual"]),
        baselines(rows),
        "![Cumulative errors, the map every 17 cm](real_images_errors.png)",
        *(section(title, rows[name], steps[name]) for name, title in (
            ("every_17_cm", "The map every 17 cm, queries half-way"), ("every_7_cm", "The map every 7 cm, queries half-way"),
            ("test_a", "Another drive: test_a in the map every 7 cm"))),
        "![test_a: from each query to its answer](real_images_route.png)",
        sequences(rows),
        distances(rows),
        ambiguity(runs, rows),
        compass(runs),
        odometry(runs),
        catchments(runs),
        commands(),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def failures(real: list[Row], virtual: list[Row], real_step: float, virtual_step: float) -> str:
    """What is good in the virtual world and not on real pictures, in steps of the map."""
    found = []
    for row in of_localizer(virtual, "nearest"):
        twin = next((each for each in of_localizer(real, "nearest") if each["method"] == row["method"]), None)
        if twin is None:
            continue
        here = number(twin, "position_error_p90_m") / real_step
        there = number(row, "position_error_p90_m") / virtual_step
        fails = there <= SHINES < here and here > WORSE * there
        found.append([row["method"], f"{there:.2f}", f"{here:.2f}", "fails" if fails else ""])
    lead = [row[0] for row in found if row[3]]
    text = (
        f"**{', '.join(f'`{name}`' for name in lead)}** shine on virtual pictures and fail on these." if lead
        else "None of the descriptors that shine on virtual pictures fails on these."
    )  # fmt: skip
    means, signature = (best_of(real, name, "nearest") for name in ("fourier_means", "fourier_signature"))
    gist, coarse = (best_of(real, name, "nearest") for name in ("gist", "gist_coarse"))
    hog, grid = (best_of(real, name, "nearest") for name in ("hog", "hog_grid"))
    why = (
        "Why, by the errors of nine in ten queries: descriptors that average each band of the panorama all around keep its"
        f" profile alone, which real outdoor pictures share over metres: `hog` {cm(hog)}, and `hog_grid`, the same histograms with"
        f" their columns kept, {cm(grid)}; `fourier_signature` {cm(signature)}, and `fourier_means`, what is left of it without"
        f" the layout around, {cm(means)}. `gist` has filters of 0.2 cycles per pixel of a panorama of 128 x 512, which is more"
        f" than strips of 120 x 25 can hold: {cm(gist)}; with 0.05 cycles (`gist_coarse`) {cm(coarse)}."
    )
    return "\n\n".join(
        ["## What fails on real pictures", text, why,
         "Position error of nine in ten queries, `nearest`, in steps of the map; it fails where that is within two steps in the virtual world, and beyond two and twice as much on real pictures:", markdown(["descriptor", "virtual square", "real, map every 17 cm", ""], found)]
    )  # fmt: skip


def baselines(rows: dict[str, list[Row]]) -> str:
    """The best of each task beside the plain baseline of the set's description."""
    lines = []
    for name, (median, most) in BASELINES.items():
        best = min(rows[name], key=lambda row: number(row, "position_error_median_m"))
        safest = min(rows[name], key=lambda row: number(row, "position_error_p90_m"))
        both = sum(
            number(row, "position_error_median_m") < median and number(row, "position_error_p90_m") < most
            for row in rows[name]
        )
        lines.append([
            name.replace("_", " "), f"{100 * median:.1f} / {100 * most:.0f}",
            *(f"`{row['method']}` by `{row['localizer']}`: {100 * number(row, 'position_error_median_m'):.1f} / {100 * number(row, 'position_error_p90_m'):.1f}"
              for row in (best, safest)), f"{both} of {len(rows[name])}",
        ])  # fmt: skip
    head = ["task", "baseline, median / 90 % [cm]", "least median", "least at 90 %", "pairs that beat it at both"]
    return f"## Beside the baseline\n\n{markdown(head, lines)}"


def section(title: str, rows: list[Row], step_m: float) -> str:
    """All methods by all localizers on one task."""
    table = [
        [row["method"], row["localizer"], *(f"{factor * number(row, column):.1f}" for _, column, factor in ERRORS)]
        for row in sorted(rows, key=lambda row: number(row, "position_error_median_m"))
    ]
    head = ["descriptor", "localizer", *(label for label, _, _ in ERRORS)]
    return f"## {title}\n\n{rows[0]['queries']} queries with a position, places {100 * step_m:.1f} cm apart (median).\n\n{markdown(head, table)}"


def sequences(rows: dict[str, list[Row]]) -> str:
    """What localizers of sequences add, over all descriptors."""
    names = ("nearest", "interpolated", "bayes_filter", "route_filter", "sequence_matching")
    lines = []
    for task in ("every_17_cm", "every_7_cm", "test_a", "ceiling", "virtual"):
        own = {name: of_localizer(rows[task], name) for name in names}
        lines.append([task.replace("_", " "), *(f"{100 * np.median([number(r, 'position_error_median_m') for r in own[n]]):.1f} / {100 * np.median([number(r, 'position_error_p90_m') for r in own[n]]):.1f}" for n in names)])  # fmt: skip
    return (
        "## Sequences\n\nMedian and 90 % error in centimetres, each the median over the descriptors. `bayes_filter` has no speed: its"
        " motion model is a step of the map in any direction, and where the robot moves more than that between two images it"
        " is behind. `route_filter` has the speed in its state and answers between places; `sequence_matching` matches the last"
        " ten images together.\n\n" + markdown(["task", *names], lines)
    )


def distances(rows: dict[str, list[Row]]) -> str:
    """Every descriptor with every distance that applies."""
    tasks = ("distances_17_cm", "distances_test_a")
    by = {task: {row["method"]: row for row in of_localizer(rows[task], "nearest")} for task in tasks}
    between = {row["method"]: row for row in of_localizer(rows[tasks[0]], "interpolated")}
    by_error = {name: number(between.get(name, row), "position_error_median_m") for name, row in by[tasks[0]].items()}
    names = sorted(by_error, key=by_error.__getitem__)
    lines = [
        [name, *(pair(row) for row in (by[tasks[0]][name], between.get(name), by[tasks[1]].get(name)))]
        for name in names
    ]
    head = ["descriptor + distance", "17 cm, nearest", "17 cm, interpolated", "test_a, nearest"]
    return (
        "## Every distance that applies\n\nMedian / 90 % in centimetres. Distances that a turn of the camera would mislead are left"
        f" out.\n\n{markdown(head, lines)}"
    )


def ambiguity(runs: Path, rows: dict[str, list[Row]]) -> str:
    """Sets of places: how large, how often with the truth, how often ambiguous."""
    tasks = ("every_17_cm", "every_7_cm", "test_a", "test_a_calibrated", "ceiling", "virtual")
    chosen = [(task, row) for task in tasks for row in of_localizer(rows[task], "nearest") if row["method"] in SHOWN]
    lines = [
        [
            task.replace("_", " "), row["method"], f"{100 * number(row, 'set_coverage'):.0f} %",
            f"{number(row, 'set_size_median'):.0f} of {metrics(runs / task)['places']:.0f}",
            f"{number(row, 'set_extent_median_m'):.2f} m", f"{100 * number(row, 'ambiguous_rate'):.0f} %",
        ] for task, row in chosen
    ]  # fmt: skip
    head = ["task", "descriptor", "hold the truth", "places (median)", "reach (median)", "ambiguous"]
    return (
        "## What the images do not tell\n\nFor each query the set of all places it may be, calibrated by the map's own places left out"
        " in turn so that 95 % hold the truth (`test_a_calibrated`: by every second query, 90 %); ambiguous are sets that reach"
        " farther than five steps of the map. `ceiling` is a ceiling of repeating lamps. Calibrated by its map, another drive"
        " need not be covered as promised: its light and its path are not those of the map.\n\n" + markdown(head, lines)
    )


def compass(runs: Path) -> str:
    """The visual compass along the drive."""
    own = metrics(runs / "every_17_cm")
    names = [key.removesuffix("_compass_error_median") for key in own if key.endswith("_compass_error_median")]
    lines = [
        [name, *(f"{own[f'{name}_compass_error_{which}']:.1f}" for which in ("median", "p90", "worst"))]
        for name in names
    ]
    return (
        "## The visual compass\n\nHeading by the rotations between all 455 consecutive images, summed up, against the course, in"
        " degrees.\n\n"
        + markdown(["descriptor", "median", "90 %", "worst"], sorted(lines, key=lambda line: float(line[1])))
    )


def odometry(runs: Path) -> str:
    """Visual odometry along the drive."""
    lines = []
    for name in ODOMETRIES:
        own = metrics(runs / f"odometry_{name}")
        lines.append([
            f"`{name}`", *(f"{own[key]:.2f}" for key in ("odometry_ate", "odometry_ate_max")), f"{100 * own['odometry_drift']:.0f} %",
            *(f"{own[f'step_{kind}_error_median']:.1f}" for kind in ("rotation", "direction")), f"{own['bridged_steps']:.0f}",
        ])  # fmt: skip
    head = ["odometry", "ATE [m]", "worst [m]", "drift", "turn of a step [°]", "direction [°]", "steps that failed"]
    return (
        f"## Visual odometry\n\nEach fifth image of the drive, {own['images']:.0f} over {own['path_length']:.1f} m, without loop closures;"
        " errors after the fit of one scale, of steps the median. Lengths have no unit here: `appearance_fit` takes the distance of two images"
        " for them, `guided_epipolar` one length for all. Strips of 120 x 25 pixels hold too few features for the epipolar"
        " odometries: a step failed where fewer than twelve matches agree.\n\n" + markdown(head, lines)
    )


def catchments(runs: Path) -> str:
    """Catchment areas and the range of the compass."""
    lines: list[list[str]] = []
    for name, unit in (("drive", "m"), ("forest", "m²"), ("virtual", "m²")):
        own = metrics(runs / f"catchment_{name}")
        lines += [
            [
                name, key, f"{own[f'{key}_catchment_median']:.2f} {unit}", f"{100 * own[f'{key}_catchment_share']:.0f} %",
                f"{own.get(f'{key}_compass_range_median', float('nan')):.1f} m",
                f"{own.get(f'{key}_compass_error_median', float('nan')):.1f}",
            ] for key in (each.removesuffix("_catchment_median") for each in own if each.endswith("_catchment_median"))
        ]  # fmt: skip
    head = ["where", "method", "catchment (median)", "of all places", "compass within 45°", "compass error [°]"]
    return (
        "## Catchment areas\n\n`pixels` is the rotational image difference function. `drive` is the Sussex drive, every 5th image,"
        " `forest` the simulated grid of 10 x 10 m, `virtual` our own square of 5 x 4 m.\n\n"
        + markdown(head, lines)
        + "\n\n![Catchments in the forest](real_images_catchment.png)"
    )


def commands() -> str:
    """The commands of all runs."""
    lines = [
        f"omnilab {' '.join(quoted(each.format(sets='DIR')) for each in overrides)}" for overrides in RUNS.values()
    ]
    return "## Commands\n\n```\n" + "\n".join(lines) + "\n```"


def pictures(runs: Path) -> None:
    """Plots of the runs, beside the page."""
    for run_name, figure, name in (
        ("every_17_cm", "errors", "errors"),
        ("test_a", "route", "route"),
        ("catchment_forest", "areas", "catchment"),
    ):
        with Image.open(runs / run_name / f"{figure}.png") as shown:
            shown.convert("RGB").resize((3 * shown.width // 4, 3 * shown.height // 4)).quantize(256).save(
                HERE / f"real_images_{name}.png", optimize=True
            )


def table(file: Path) -> list[Row]:
    with file.open() as text:
        return list(csv.DictReader(text))


def metrics(folder: Path) -> dict[str, float]:
    return {
        row["metric"] if "metric" in row else row["name"]: float(row["value"] or "nan")
        for row in table(folder / "metrics.csv")
    }


def of_localizer(rows: Iterable[Row], name: str) -> list[Row]:
    return [row for row in rows if row["localizer"] == name]


def best_of(rows: Iterable[Row], method: str, localizer: str) -> Row:
    return next(row for row in rows if row["method"] == method and row["localizer"] == localizer)


def number(row: Row, column: str) -> float:
    return float(row[column] or "nan")


def cm(row: Row) -> str:
    return f"{100 * number(row, 'position_error_p90_m'):.0f} cm"


def pair(row: Row | None) -> str:
    if row is None:
        return "–"
    return f"{100 * number(row, 'position_error_median_m'):.1f} / {100 * number(row, 'position_error_p90_m'):.1f}"


def quoted(text: str) -> str:
    return f"'{text}'" if any(sign in text for sign in "[]~") else text


def markdown(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row))} |" for row in rows)])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
