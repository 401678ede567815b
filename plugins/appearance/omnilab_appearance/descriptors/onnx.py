"""Learned descriptor: a network in an ONNX file."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from omnilab.api import Bytes, Floats, Signatures, check_settings, setting
from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import content_of
from omnilab.image import to_color

LARGEST_FILE = 2**31  # bytes


class Order(Enum):
    """Channel order of a network's input."""

    rgb = "rgb"
    bgr = "bgr"
    gray = "gray"


@dataclass
class Onnx:
    """A network from a local ONNX file, run by ONNX Runtime on the CPU. Nothing is ever downloaded.

    Panoramas are resized to `height` x `width`, scaled to [0, 1], normalised by `mean` and `std`, and handed over as
    (1, channels, height, width) float32. The output, of any shape, is the signature. The manifest records the file's
    SHA-256. Nothing is known of the output under rotation: `rotation` is "none".
    """

    model: str = "???"  # the ONNX file
    height: int = setting(128, at_least=1, at_most=8192)  # of the network's input
    width: int = setting(512, at_least=1, at_most=8192)  # of the network's input
    order: Order = Order.rgb  # rgb, bgr or gray
    mean: list[float] = setting([0.485, 0.456, 0.406])  # of each channel, of grey levels in [0, 1]
    std: list[float] = setting([0.229, 0.224, 0.225], above=0)  # of each channel
    output: str | None = None  # the name of the output; null: the last
    normalize: bool = True  # to unit length

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "none"
    default_distance: ClassVar[str] = "cosine"

    def __post_init__(self) -> None:
        check_settings(self)
        channels = 1 if self.order is Order.gray else 3
        if len(self.mean) != channels or len(self.std) != channels or min(self.std) <= 0:
            raise ConfigError(
                f"mean={self.mean}, std={self.std} do not fit {channels} channel(s); give {channels} of each, std above 0"
            )

    @property
    def color(self) -> bool:
        """RGB, unless the network wants grey."""
        return self.order is not Order.gray

    def describe(self, images: Bytes) -> Signatures:
        """Outputs (N, ...) for panoramas (N, H, W[, 3])."""
        found = [self._output(inputs[None]) for inputs in self._inputs(images)]
        place = np.stack(found)
        if not np.isfinite(place).all():
            raise DataError(f"{self.model} answers with NaN or infinity; check its normalisation (mean, std)")
        return Signatures(_unit(place) if self.normalize else place)

    def _inputs(self, images: Bytes) -> Floats:
        """(N, channels, height, width) float32."""
        import cv2

        views = to_color(images) if self.color else images[..., None]
        if self.order is Order.bgr:
            views = views[..., ::-1]
        size = (self.width, self.height)
        small = [cv2.resize(np.ascontiguousarray(p), size, interpolation=cv2.INTER_AREA) for p in views]
        scaled = np.stack(small).reshape(len(images), self.height, self.width, -1) / np.float32(255)
        normal = (scaled - np.asarray(self.mean, np.float32)) / np.asarray(self.std, np.float32)
        return np.ascontiguousarray(np.moveaxis(normal, -1, 1), np.float32)

    def _output(self, inputs: Floats) -> Floats:
        session = self._session
        expected = session.get_inputs()[0]
        if len(expected.shape) != 4 or any(
            isinstance(n, int) and n != m for n, m in zip(expected.shape, inputs.shape, strict=True)
        ):
            raise DataError(
                f"{self.model} takes an input of {expected.shape}, not {list(inputs.shape)}; set descriptor.height, width and"
                " order as the network wants them"
            )
        names = [output.name for output in session.get_outputs()]
        if self.output is not None and self.output not in names:
            raise DataError(f"{self.model} has no output '{self.output}'; it has {', '.join(names)}")
        (found,) = session.run([self.output or names[-1]], {expected.name: inputs})
        return np.array(found[0], np.float32)

    @cached_property
    def _session(self) -> Any:
        file = Path(self.model)
        try:
            network = content_of(file, LARGEST_FILE)
        except OSError as error:
            raise DataError(
                f"{self.model} cannot be read ({error.strerror}); give descriptor.model=FILE, an ONNX file"
            ) from None
        try:
            import onnxruntime as ort
        except ImportError:
            raise ConfigError(
                "descriptor=onnx needs onnxruntime, which is not installed; pip install 'omnilab-appearance[onnx]'"
            ) from None
        options = ort.SessionOptions()
        options.intra_op_num_threads = 1  # sums are made in the same order everywhere
        try:
            # from memory: a file's external data could lie anywhere on the disk
            return ort.InferenceSession(network, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # noqa: BLE001  its exceptions share no other base
            first = str(error).strip().splitlines()[0][:200]
            raise DataError(f"{self.model} is no ONNX file that can be run ({first}); export it anew") from None

    def __getstate__(self) -> dict[str, Any]:
        """Settings alone: a network is read again where it is needed."""
        return {name: value for name, value in vars(self).items() if name != "_session"}


def _unit(place: Floats) -> Floats:
    flat = place.reshape(len(place), -1)
    return np.asarray(place / np.maximum(np.linalg.norm(flat, axis=1), 1e-12).reshape(-1, *[1] * (place.ndim - 1)))
