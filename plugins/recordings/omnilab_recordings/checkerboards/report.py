"""What a calibration is told by: tables on the terminal, and a JSON with all numbers."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Floats
from omnilab.atomic_files import write_whole
from omnilab.cameras.calibration import CalibrationResult, Candidate
from omnilab.errors import visible

Table = tuple[Sequence[str], list[Sequence[str]]]  # header and rows


def models_table(calibration: CalibrationResult) -> Table:
    """Each model with its errors; the one that was chosen is marked."""
    rows: list[Sequence[str]] = [
        (c.fit.model.name, str(len(c.fit.model.free)), f"{c.fit.rms_px:.3f}", f"{c.held_out_px:.3f}", "chosen" * (c is calibration.chosen))
        for c in calibration.candidates
    ]  # fmt: skip
    rows += [(name, "", "", "", why) for name, why in calibration.failed.items()]
    return ("model", "settings", "rms [px]", "boards left out [px]", ""), rows


def boards_table(calibration: CalibrationResult) -> Table:
    """Each board with its error and where it was, by the chosen model."""
    rows: list[Sequence[str]] = [
        (b["image"], str(b["corners"]), f"{b['rms_px']:.3f}", f"{b['worst_px']:.2f}", f"{b['distance_m']:.3f}", f"{b['tilt_deg']:.0f}")
        for b in _boards(calibration)
    ]  # fmt: skip
    return ("board", "corners", "rms [px]", "worst [px]", "distance [m]", "tilt [deg]"), rows


def sentences(calibration: CalibrationResult) -> Iterator[str]:
    """What is not in the tables."""
    chosen, boards = calibration.chosen, calibration.corners
    least = ", the least of the models" if len(calibration.candidates) > 1 else ""
    yield (
        f"{chosen.fit.model.name}: {chosen.fit.rms_px:.3f} px rms over {len(boards.names)} boards,"
        f" {chosen.held_out_px:.3f} px on boards left out{least}"
    )
    for name, why in calibration.left_out.items():
        yield f"left out: {name} {why}"
    if calibration.wrong_corners:
        yield f"left out: {calibration.wrong_corners} corners that lie off the others' errors"
    yield (
        f"the corners reach {calibration.reach_px:.0f} px from the axis, {calibration.reach_px / calibration.rim_px:.0%} of the"
        f" {calibration.rim_px:.0f} px to the {'rim' if calibration.camera.rim_px else 'nearest edge'}; beyond, the model is extrapolated"
    )
    angle, sigma = max(calibration.uncertainty_px.items())
    yield f"by the boards, a ray at {angle:.0f} degrees is known to {sigma:.2f} px (one standard deviation)"


def print_table(table: Table) -> None:
    """On standard output, as wide as it needs to be where no person reads it."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    header, rows = table
    rich = RichTable(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for name in header:
        rich.add_column(Text(name))
    for row in rows:
        rich.add_row(*(Text(visible(cell)) for cell in row))
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(width=max(80, console.measure(rich, options=console.options.update(width=10_000)).maximum))
    console.print(rich)


def write_report(file: Path, calibration: CalibrationResult) -> None:
    """All numbers as JSON: models, settings with their standard deviations and covariance, boards with poses."""
    fit = calibration.chosen.fit
    deviation = np.sqrt(np.diag(calibration.covariance))
    settings = fit.model.settings(fit.camera)
    content = {
        "model": fit.model.name,
        "board": {"rows": calibration.corners.board.rows, "columns": calibration.corners.board.columns,
                  "square_m": calibration.corners.board.square_m},
        "rms_px": fit.rms_px,
        "left_out_boards_px": calibration.chosen.held_out_px,
        "models": {c.fit.model.name: _of_model(c) for c in calibration.candidates},
        "models_that_failed": dict(calibration.failed),
        "settings": {
            name: {"value": float(value), "standard_deviation": float(sigma)}
            for name, value, sigma in zip(fit.model.free, settings, deviation, strict=True)
        },
        "covariance": calibration.covariance.tolist(),
        "uncertainty_px": [
            {"angle_deg": angle, "standard_deviation": sigma} for angle, sigma in calibration.uncertainty_px.items()
        ],
        "reach_px": calibration.reach_px,
        "rim_px": calibration.rim_px,
        "boards": list(_boards(calibration)),
        "left_out": dict(calibration.left_out),
        "wrong_corners": calibration.wrong_corners,
    }  # fmt: skip
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    write_whole(file, lambda out: out.write(text.encode()))


def _of_model(candidate: Candidate) -> dict[str, Any]:
    return {"rms_px": candidate.fit.rms_px, "left_out_boards_px": candidate.held_out_px}


def _boards(calibration: CalibrationResult) -> Iterator[dict[str, Any]]:
    """Each board; its pose is of the board's frame (x along columns, y along rows) to right, down and forward."""
    fit, boards = calibration.chosen.fit, calibration.corners
    t_m: Floats = fit.t * boards.board.square_m
    for i, name in enumerate(boards.names):
        error = np.linalg.norm(fit.errors_px[i], axis=-1)
        middle = fit.R[i] @ boards.board.points.mean(0) + fit.t[i]
        cosine = abs(fit.R[i, :, 2] @ middle) / np.linalg.norm(middle)
        yield {
            "image": name, "corners": int(boards.seen[i].sum()), "rms_px": float(fit.board_rms_px[i]),
            "worst_px": float(np.nanmax(error)), "distance_m": float(np.linalg.norm(middle)) * boards.board.square_m,
            "tilt_deg": float(np.rad2deg(np.arccos(min(1.0, cosine)))),
            "R_camera_board": fit.R[i].tolist(), "t_camera_board_m": t_m[i].tolist(),
        }  # fmt: skip
