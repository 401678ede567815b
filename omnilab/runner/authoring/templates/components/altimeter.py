"""An altimeter: how far the panorama moves down as the camera rises."""

from dataclasses import dataclass

import numpy as np
from omnilab import (
    Altimeter,
    Bytes,
    Camera,
    ConfigError,
    Floats,
    Heights,
    check_settings,
    setting,
)
from omnilab.geometry import wrap_angle
from omnilab.image import panorama, to_gray


@dataclass
class MyAltimeter:
    """The shift of the rows after which two panoramas differ least.

    Seen from higher up everything lies lower, near things more so than far ones: the value
    is a number of rows, and says little more than which image is the higher one. Before,
    the test is turned to the reference's heading, by the correlation of their columns.
    """

    rows: int = setting(64, at_least=8, at_most=1024)  # of the panoramas
    most: int = setting(12, at_least=1, at_most=500)  # rows of the largest shift

    def __post_init__(self) -> None:
        check_settings(self)
        if 2 * self.most >= self.rows:
            raise ConfigError(f"most={self.most} leaves none of rows={self.rows}")

    def relative(self, references: Bytes, tests: Bytes, camera: Camera) -> Heights:
        """Rows that tests (N, H, W) lie lower than references (N, H, W) or (1, H, W)."""
        shape = (self.rows, 4 * self.rows)
        before = panorama(to_gray(references), camera, shape).astype(np.float32)
        now = panorama(to_gray(tests), camera, shape).astype(np.float32)
        before = np.broadcast_to(before, now.shape)
        turns = _turns(before, now)
        now = np.stack([np.roll(n, t, axis=1) for n, t in zip(now, turns, strict=True)])
        curve = self._differences(before, now)
        mean, least = curve.mean(axis=1), curve.min(axis=1)
        seen = mean > 0
        confidence = np.where(seen, 1 - least / np.where(seen, mean, 1), 0.0)
        rows = curve.argmin(axis=1) - self.most
        return Heights(
            value=np.where(seen, rows, np.nan),  # NaN: nothing to be seen
            unit="rows",
            confidence=confidence,
            rotation_rad=wrap_angle(2 * np.pi * turns / shape[1]),
            curves={"difference": curve},
        )

    def _differences(self, before: Floats, now: Floats) -> Floats:
        """Mean differences (N, shifts) with the tests shifted by -most to most rows."""
        most, inner = self.most, before[:, self.most : self.rows - self.most]
        shifts = range(2 * most + 1)
        moved = [now[:, s : s + inner.shape[1]] for s in shifts]
        return np.stack([np.abs(m - inner).mean(axis=(1, 2)) for m in moved], axis=1)


def _turns(before: Floats, now: Floats) -> Floats:
    """Columns (N,) by which the camera has turned to the left in between."""
    spectra = [np.fft.rfft(each.mean(axis=1)) for each in (before, now)]
    correlation = np.fft.irfft(spectra[1].conj() * spectra[0], before.shape[2])
    return np.asarray(correlation.argmax(axis=1))


# a type checker compares it with the contract:
_: type[Altimeter] = MyAltimeter
