"""Videos made for the tests: moving texture, in any codec and container."""

import random
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest


def texture(width, height, seed=0):
    """A smooth picture with structure at all scales, over the whole range of grey."""
    noise = np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


@pytest.fixture
def pictures():
    """Makes so many grey pictures of a texture that moves by a pixel each."""

    def make(count=40, width=96, height=64):
        wide = texture(width + count, height)
        return [np.ascontiguousarray(wide[:, i : i + width]) for i in range(count)]

    return make


@pytest.fixture
def write_video(tmp_path):
    """Writes grey or RGB pictures as a video: `times_ms` of each, or `rate` a second."""

    def write(
        name,
        images,
        codec="ffv1",
        pix_fmt="gray",
        rate=20,
        times_ms=None,
        options=None,
        gop=None,
        b_frames=None,
        **metadata,
    ):
        file = tmp_path / name
        with av.open(str(file), "w") as container:
            container.metadata.update(metadata)
            stream = container.add_stream(codec, rate=rate, options=options or {})
            stream.height, stream.width = images[0].shape[:2]
            stream.pix_fmt = pix_fmt
            if times_ms is not None:
                stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
            if gop is not None:
                stream.codec_context.gop_size = gop
            if b_frames is not None:
                stream.codec_context.max_b_frames = b_frames
            for i, image in enumerate(images):
                frame = av.VideoFrame.from_ndarray(image, format="gray" if image.ndim == 2 else "rgb24")
                frame = frame if frame.format.name == pix_fmt else frame.reformat(format=pix_fmt)
                frame.pts = i if times_ms is None else times_ms[i]
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        return file

    return write


@pytest.fixture
def damage():
    """Overwrites the middle of a packet of a video."""

    def damaged(file, number):
        with av.open(str(file)) as container:
            packet = bytes([p for p in container.demux(video=0) if p.size][number])
        data = bytearray(file.read_bytes())
        at, length = bytes(data).index(packet) + len(packet) // 3, max(4, len(packet) // 3)
        data[at : at + length] = random.Random(3).randbytes(length)
        file.write_bytes(data)

    return damaged
