"""Command `omnilab camera convert`: the file of a camera as one of another tool."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from omnilab.cameras import load_camera, save_camera
from omnilab.cameras.calibration import MODELS, refit
from omnilab.cameras.export import FORMS, export_camera
from omnilab.cameras.lenses import AxialCamera
from omnilab.errors import ConfigError, visible

OURS = "omnilab"


def camera_command(argv: Sequence[str]) -> int:
    """Convert the file of a camera into one of another tool."""
    options = _parser().parse_args(argv)
    output: Path = options.output
    if output.exists() and not options.overwrite:
        raise ConfigError(f"{output} exists; give another -o FILE, or --overwrite")
    size = _size(options.size)
    camera = load_camera(options.camera, options.looks, options.entry, options.distortion, size)
    if options.refit:
        if not isinstance(camera, AxialCamera):
            raise ConfigError(
                f"a {type(camera).__name__} is not refitted; give the file of a lens or a calibrated mirror"
            )
        found = refit(camera, options.refit)
        camera = found.camera
        _say(
            f"{options.refit} shows rays {found.rms_px:.2g} px rms from where the camera does, {found.largest_px:.2g} px at most"
        )
    if options.to == OURS:
        save_camera(camera, output)
    else:
        export_camera(camera, output, options.to)
        _say("where the camera looks, and its circle, are not in the file: say them again where it is read")
    _say(f"written: {output}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab camera", description="Files of cameras.")
    actions = parser.add_subparsers(dest="action", required=True)
    convert = actions.add_parser("convert", help="as a file of another tool")
    add = convert.add_argument
    add("camera", metavar="FILE", help="any file of a camera that is read (docs/cameras.md)")
    add("-o", "--output", type=Path, required=True, metavar="FILE", help="the file to write")
    add("--to", required=True, choices=[OURS, *FORMS], help="whose file")
    add("--refit", choices=list(MODELS), help="as another model, which is said to be how far off")
    add("--looks", choices=["down", "up", "ahead"], help="where the camera looks, if its file does not say")
    add("--entry", metavar="CAM", help="which camera of a file with several, such as cam1")
    add("--distortion", choices=["radtan", "equidistant"], help="of OpenCV's files that do not say")
    add("--size", metavar="WxH", help="of the pictures, if the file does not say, such as 1024x768")
    add("--overwrite", action="store_true", help="replace the file where it is there")
    return parser


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and len(text) < 12):
        raise ConfigError(f"--size {text} is no size; give one such as 1024x768")
    return int(width), int(height)


def _say(line: str) -> None:
    sys.stdout.write(visible(line) + "\n")
