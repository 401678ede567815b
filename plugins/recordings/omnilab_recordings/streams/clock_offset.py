"""The offset of two clocks: by the turns that images show, and those of poses."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab_recordings.streams.poses import SECOND_NS, PoseSource

LEAST_TURN_RAD = np.pi / 2  # that the images must show in all
LEAST_IMAGES = 10
ALIKE = 0.6  # least correlation of the turns at the right offset
DISTINCT = 0.85  # of the best correlation, that no other offset may reach
LEAST_SHARE = 0.25  # of the shorter recording, that the other must cover
MOST_OFFSETS = 100_000
AT_A_TIME = 2_000_000  # numbers
GIVE = "give sensor.clock_offset_s, or take the file of this recording"


def estimate_offset(turns_rad: Floats, images_ns: Ints, source: PoseSource) -> tuple[float, float]:
    """Seconds that bring poses to the clock of the images, and the correlation (at most 1) of both turns there.

    `turns_rad` (N - 1,) is by how much each image is turned from the one before, counter-clockwise. Turns of the headings
    between the same two times are correlated with it at every offset at which a part of both recordings coincides; the
    best is refined by a parabola. DataError where no offset stands out.
    """
    if len(images_ns) < LEAST_IMAGES or np.abs(turns_rad).sum() < LEAST_TURN_RAD:
        raise DataError(
            f"the clock of {source.of} cannot be estimated: {len(images_ns)} images show turns of"
            f" {np.rad2deg(np.abs(turns_rad).sum()):.0f} degrees in all, too little to tell; {GIVE}"
        )
    time_s = (images_ns - images_ns[0]) / SECOND_NS
    pose_s = (source.stamps_ns - source.stamps_ns[0]) / SECOND_NS
    heading = np.unwrap(heading_of(source.T_world_camera))
    offsets = _offsets(time_s, pose_s)
    # wheels may turn the other way in mirrored pictures: then the best of all correlations is negative
    found = _correlations(turns_rad, time_s, pose_s, heading, offsets)
    best = int(np.argmax(np.abs(found)))
    _check_stands_out(found, best, source.of)
    offset = _peak(found, offsets, best) + (int(images_ns[0]) - int(source.stamps_ns[0])) / SECOND_NS
    return offset, float(found[best])


def _offsets(time_s: Floats, pose_s: Floats) -> Floats:
    """Offsets to try: from the last pose on the first image to the first on the last, less what must coincide."""
    least = LEAST_SHARE * min(time_s[-1], pose_s[-1])
    first, last = least - pose_s[-1], time_s[-1] - least
    step = max(min(np.median(np.diff(time_s)), np.median(np.diff(pose_s))) / 2, (last - first) / MOST_OFFSETS)
    return np.arange(first, last + step / 2, step)


def _correlations(turns_rad: Floats, time_s: Floats, pose_s: Floats, heading: Floats, offsets: Floats) -> Floats:
    """The correlation (M,) of turns and of headings' differences at each offset (M,); what no pose covers counts against."""
    found = []
    for some in np.array_split(offsets, max(1, len(offsets) * len(time_s) // AT_A_TIME)):
        at = time_s[None] - some[:, None]
        outside = (at < pose_s[0]) | (at > pose_s[-1])
        turned = wrap_angle(np.diff(np.interp(at, pose_s, heading), axis=1))
        turned[outside[:, 1:] | outside[:, :-1]] = 0
        power = np.sqrt((turned**2).sum(axis=1) * (turns_rad**2).sum())
        found.append(turned @ turns_rad / np.maximum(power, 1e-12))
    return np.concatenate(found)


def _check_stands_out(found: Floats, best: int, of: str) -> None:
    """DataError unless the best correlation is high, positive, and that of no other peak is nearly as high."""
    low = np.flatnonzero(np.abs(found) < 0.5 * abs(found[best]))
    begin, end = low[low < best].max(initial=0), low[low > best].min(initial=len(found))  # of the best one's own peak
    second = float(np.abs(np.r_[found[:begin], found[end:]]).max(initial=0.0))
    if abs(found[best]) < ALIKE or second > DISTINCT * abs(found[best]):
        raise DataError(
            f"the clock of {of} cannot be estimated: turns of images and of poses correlate to {found[best]:.2f} at best, and to"
            f" {second:.2f} at another offset; {GIVE}"
        )
    if found[best] < 0:
        raise DataError(
            f"the clock of {of} cannot be estimated: where turns of images and of poses agree best, they run against each"
            f" other (correlation {found[best]:.2f}); give sensor.mirrored=true if pictures are mirrored, or mend the headings"
        )


def _peak(found: Floats, offsets: Floats, best: int) -> float:
    """The offset of a maximum, between those that were tried."""
    if not 0 < best < len(found) - 1:
        return float(offsets[best])
    left, top, right = found[best - 1 : best + 2]
    bend = left - 2 * top + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float(offsets[best] + np.clip(shift, -1, 1) * (offsets[1] - offsets[0]))
