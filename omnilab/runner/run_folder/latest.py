"""The link `latest`, to the newest run."""

from __future__ import annotations

import logging
import os
import secrets
from pathlib import Path

from omnilab.errors import DataError

log = logging.getLogger("omnilab")


def check_latest(link: Path) -> None:
    """DataError where something of the user's lies in the place of the link."""
    if link.exists() and not link.is_symlink():
        kind = "folder" if link.is_dir() else "file"
        raise DataError(
            f"{link} is a {kind}, and a link to the newest run belongs there; rename the {kind}, or give another logs=DIR"
        )


def point_latest(link: Path, folder: Path) -> None:
    """Make the link point at the folder, atomically, by a relative path; a warning where the disk has no links."""
    part = link.with_name(f".latest-{secrets.token_hex(4)}")
    try:
        link.parent.mkdir(parents=True, exist_ok=True)
        part.symlink_to(os.path.relpath(folder.resolve(), link.parent.resolve()))
        part.replace(link)
    except OSError as error:
        part.unlink(missing_ok=True)
        log.warning("%s cannot be made (%s); give the run's folder, %s, instead", link, error.strerror, folder)
