"""Descriptors on a device: what takes their time is done there, what is small is left to the descriptor itself."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import torch

from omnilab.api import Bytes, Floats
from omnilab_appearance.accelerated.on_device import HELD, OnDevice, Tensor
from omnilab_appearance.accelerated.resampling import along, halved_taps, reflected, resized_taps
from omnilab_appearance.common.circular_correlation import Spectra
from omnilab_appearance.common.gabor import transfer_functions
from omnilab_appearance.common.image_ops import check_rows
from omnilab_appearance.descriptors.fourier_signature import FourierSignature
from omnilab_appearance.descriptors.gist import Gist
from omnilab_appearance.descriptors.hog import Hog, check_has_gradients
from omnilab_appearance.descriptors.radon import Radon, inside_circle


class FourierSignatureOnTorch(OnDevice, FourierSignature):
    """`fourier_signature`: the spectra of rows come from the device."""

    def _spectra(self, images: Bytes) -> Spectra:
        check_rows(self.rows, images.shape[1])
        used = self._frequencies(images.shape[2])

        def spectra(block: Tensor) -> tuple[Tensor, ...]:
            rows = with_rows(block, self.rows, self)
            first = rows[:, :, :1]  # without which a constant row is zero, and has no phase in any library
            found = torch.fft.rfft(rows - first)[:, :, :used]
            found[:, :, :1] += rows.shape[2] * first
            return (found,)

        return self.in_blocks(spectra, images)[0]


class HogOnTorch(OnDevice, Hog):
    """`hog`: the sums of gradients come from the device."""

    def _gradient_sums(self, images: Bytes) -> tuple[Floats, Floats]:
        check_rows(self.rows, images.shape[1])
        check_has_gradients(self.rows, images.shape[2])
        rows, columns = self.in_blocks(lambda block: self._sums(with_rows(block, self.rows, self)), images)
        return rows / np.float32(images.shape[2]), columns

    def _sums(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Sums of rows (N, H, bins) and of columns (N, bins, W), in double precision: bins are those of the CPU."""
        fine = images.to(torch.float64)
        across = fine.roll(-1, 2) - fine.roll(1, 2)
        down = torch.zeros_like(fine)
        down[:, 1:-1] = fine[:, 2:] - fine[:, :-2]
        strength = torch.sqrt(across * across + down * down)
        side = 1 - 2 * ((down < 0) | ((down == 0) & (across < 0))).to(torch.float64)  # modulo half a turn
        across, down = side * across, side * down
        bins = torch.zeros_like(fine, dtype=torch.int16)
        for angle in (math.pi * edge / self.bins for edge in range(1, self.bins)):
            bins += math.cos(angle) * down - math.sin(angle) * across >= 0
        sums = [torch.where(bins == k, strength, 0.0) for k in range(self.bins)]
        rows = torch.stack([each.sum(2) for each in sums], 2)
        return rows.to(torch.float32), torch.stack([each.sum(1) for each in sums], 1).to(torch.float32)


class GistOnTorch(OnDevice, Gist):
    """`gist`: the means of Gabor energies come from the device."""

    def _energy_means(self, images: Bytes) -> Iterator[tuple[Floats, Floats]]:
        check_rows(self.rows, images.shape[1])
        found = self.in_blocks(self._means, images)
        yield found[0], found[1]
        yield found[2], found[3]

    def _means(self, images: Tensor) -> tuple[Tensor, ...]:
        """Means of rows and of columns, of either level."""
        fine = with_rows(images, self.rows, self)
        half = along(along(fine, halved_taps(fine.shape[2], True), 2, self), halved_taps(fine.shape[1], False), 1, self)
        return *self._energies(fine), *self._energies(half)

    def _energies(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Means of the rows (N, M, H) and of the columns (N, M, W) of the energies of images (N, H, W)."""
        height, width = images.shape[1:]
        transfers, margin = transfer_functions(height, width, self.orientations, self.frequency)
        spectra = torch.fft.fft2(images.index_select(1, self.there(reflected(height, margin))))
        rows, columns = [], []
        for transfer in transfers:
            energy = torch.fft.ifft2(spectra * self.there(transfer))[:, margin : margin + height].abs()
            rows.append(energy.mean(2, dtype=torch.float64))
            columns.append(energy.mean(1))
        return torch.stack(rows, 1), torch.stack(columns, 1)


class RadonOnTorch(OnDevice, Radon):
    """`radon`: the integrals come from the device, by the weights of the CPU's bilinear samples."""

    def _line_integrals(self, images: Bytes, directions_rad: Floats) -> Floats:
        taps, circle = resized_taps(images.shape[1], self.offsets), self.there(inside_circle(self.offsets))

        def integrals(block: Tensor) -> tuple[Tensor]:
            small = circle * along(along(block, taps, 2, self), taps, 1, self)
            pixels = torch.nn.functional.pad(small, (2, 2, 2, 2)).flatten(1).T.contiguous()  # the batch comes last
            return (torch.cat([self._sums(pixels, some) for some in self._in_turn(directions_rad)]).permute(2, 1, 0),)

        return self.in_blocks(integrals, images)[0]

    def _in_turn(self, directions_rad: Floats) -> Iterator[Floats]:
        """A few directions at a time, so that their samples are held at once."""
        step = max(1, HELD // (16 * self.offsets**2))
        yield from (directions_rad[start : start + step] for start in range(0, len(directions_rad), step))

    def _sums(self, pixels: Tensor, directions_rad: Floats) -> Tensor:
        """Line integrals (M, n, N) of pixels ((n + 4)^2, N): `line_sums` of the CPU, which has the equations."""
        n, width = self.offsets, self.offsets + 4
        cos, sin = (self.there(of(directions_rad))[:, None, None] for of in (np.cos, np.sin))
        center = (n - 1) / 2
        d = (torch.arange(n, dtype=torch.float64, device=self.device) - center)[:, None]
        t = d.T
        x = center + d * cos + t * sin + 2.0  # (M, n, n): direction, line, sample
        y = center - d * sin + t * cos + 2.0
        reach = ((n / 2) ** 2 - d * d).clamp_min(0).sqrt() + 2.0  # the CPU begins and ends a line there
        counts = (t >= (center - reach).trunc() - center) & (t <= (center + reach).trunc() + 1 - center)
        counts = counts & (x >= 0) & (y >= 0) & (x < n + 3) & (y < n + 3)
        c, r = (torch.where(counts, each, 0.0).floor() for each in (x, y))
        u, v = x - c, y - r
        weights = torch.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], -1) * counts[..., None]
        corners = torch.tensor([0, 1, width, width + 1], dtype=torch.int32, device=self.device)
        where = (r * width + c).to(torch.int32)[..., None] + corners
        sums = torch.nn.functional.embedding_bag(
            where.flatten(0, 1).flatten(1),
            pixels,
            per_sample_weights=weights.to(torch.float32).flatten(0, 1).flatten(1),
            mode="sum",
        )
        return sums.reshape(len(directions_rad), n, -1)


def with_rows(images: Tensor, rows: int, on: OnDevice) -> Tensor:
    """Panoramas (N, rows, W), each row the mean of those it covers."""
    return images if rows == images.shape[1] else along(images, resized_taps(images.shape[1], rows), 1, on)
