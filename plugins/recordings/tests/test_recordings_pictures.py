"""Image files are read within bounds, and damage is a sentence that names the file."""

from __future__ import annotations

import io
import os
import struct
import zlib
from contextlib import suppress

import cv2
import numpy as np
import pytest
from PIL import Image

from omnilab.api import RecordedPoses
from omnilab.errors import DataError
from omnilab_recordings import Folder
from omnilab_recordings.checks.command import check
from omnilab_recordings.folder import OnBadImage
from omnilab_recordings.images.decoding import MOST_PIXELS, Decoder
from omnilab_recordings.images.headers import read_header

FORMATS = ["PNG", "JPEG", "TIFF", "WEBP", "BMP", "PPM"]


def texture(seed=0, shape=(48, 64)):
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    return cv2.GaussianBlur(noise, (9, 9), 3)


def encoded(pixels, kind, **options):
    """An image file of any kind, lossless where there is a choice."""
    stream = io.BytesIO()
    extra = {"WEBP": {"lossless": True, "exact": True}, "JPEG": {"quality": 95}}.get(kind, {})
    image = pixels if isinstance(pixels, Image.Image) else Image.fromarray(pixels)
    image.save(stream, kind, **extra, **options)
    return stream.getvalue()


def write(folder, **files):
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name.replace("__", ".")).write_bytes(data)
    return folder


def read_all(sensor):
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))])


def warnings_of(caplog):
    texts = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    return [text for text in texts if "no dark surround" not in text]  # these pictures are no mirror's


def findings(folder, capsys, *options):
    assert check([str(folder), "-o", os.devnull + ".png", *options]) == 0
    return capsys.readouterr().out


@pytest.fixture(autouse=True)
def no_picture(monkeypatch):
    monkeypatch.setattr("omnilab_recordings.checks.command.write_report_picture", lambda *_: None)


# -------------------------------------------------------------------------------------------------------------- headers
@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_headers_tell_the_size(kind, mode):
    header = read_header(encoded(Image.fromarray(texture()).convert(mode), kind), "x")
    assert (header.width, header.height, header.bits, header.pages, header.orientation) == (64, 48, 8, 1, 1)
    assert not header.alpha


@pytest.mark.parametrize("data", [
    b"P5\n# 9 9\n64 48\n# a comment\n4095\n", b"P2 64 48 4095 ", b"P6\t64\r\n48 4095\n", b"P3\n64 #\n48\n4095\n",
])  # fmt: skip
def test_headers_of_netpbm_have_comments(data):
    header = read_header(data, "x")
    assert (header.width, header.height, header.largest, header.bits) == (64, 48, 4095, 16)


def test_other_headers():
    assert read_header(encoded(texture(), "WEBP"), "x").alpha is False
    lossy = cv2.imencode(".webp", texture(), [cv2.IMWRITE_WEBP_QUALITY, 50])[1].tobytes()
    assert (read_header(lossy, "x").width, read_header(lossy, "x").height) == (64, 48)
    progressive = encoded(texture(), "JPEG", progressive=True)
    assert read_header(progressive, "x").height == 48
    big = encoded(texture(), "TIFF", big_tiff=True)
    assert big[2] == 43
    assert read_header(big, "x").width == 64
    top_down = bytearray(cv2.imencode(".bmp", texture())[1].tobytes())
    top_down[22:26] = struct.pack("<i", -48)
    assert read_header(bytes(top_down), "x").height == 48


@pytest.mark.parametrize("kind", FORMATS)
def test_a_header_that_is_cut_short_is_no_header(kind):
    data = encoded(texture(), kind)
    for length in (2, 3, 9, 13, 20, 25):
        with pytest.raises(DataError, match=r"^x\.y is (truncated|damaged|empty)"):
            Decoder().decode(data[:length], "x.y")


@pytest.mark.parametrize("kind", FORMATS)
def test_noise_behind_a_magic_number_ends_in_a_sentence(kind, capfd):
    rng = np.random.default_rng(0)
    good = bytearray(encoded(texture(), kind))
    for _ in range(60):
        data = good.copy()
        for at in rng.integers(0, min(len(data), 200), 3):
            data[at] = rng.integers(0, 256)
        with suppress(DataError):
            Decoder(color=True).decode(bytes(data), "x.y")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(("data", "sentence"), [
    (b"\0\0\0\x18ftypheic\0\0\0\0", "is a HEIC, whatever its name says"),
    (b"\0\0\0\x18ftypavif\0\0\0\0", "is an AVIF"),
    (b"GIF89a", "is a GIF"),
    (b"<!DOCTYPE html>", "is a web page"),
    (b"%PDF-1.5", "is a PDF"),
    (b"Pf\n4 4\n-1.0\n", "is a PFM"),
    (b"version https://git-lfs.github.com/spec/v1\noid sha256:1\n", r"is but a pointer of Git LFS .*git lfs pull"),
])  # fmt: skip
def test_what_is_no_image_is_named_for_what_it_is(data, sentence):
    with pytest.raises(DataError, match=rf"^a\.png {sentence}"):
        Decoder().decode(data, "a.png")


# --------------------------------------------------------------------------------------------------------------- bounds
def png(width, height, data=b"", bits=8):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def tiff(entries, pixels=b""):
    """A little-endian TIFF of one page with entries (tag, type, value), its pixels behind."""
    directory = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in entries)
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + directory + bytes(4) + pixels


def with_size(kind, width, height):
    """A file whose header claims a size, with next to nothing in it."""
    small = bytearray(encoded(texture(), {"TILES": "TIFF"}.get(kind, kind)))
    match kind:
        case "PNG":
            return png(width, height)
        case "JPEG":
            at = small.index(b"\xff\xc0")
            small[at + 5 : at + 9] = struct.pack(">HH", height, width)
        case "BMP":
            small[18:26] = struct.pack("<ii", width, height)
        case "PPM":
            return b"P5 %d %d 255\n" % (width, height)
        case "WEBP":
            small[21:25] = struct.pack("<I", width - 1 | (height - 1) << 14)
        case "TIFF":
            return tiff([(256, 4, width), (257, 4, height), (258, 3, 8)])
        case "TILES":
            return tiff([(256, 4, 64), (257, 4, 48), (258, 3, 8), (322, 4, width), (323, 4, height)])
    return bytes(small)


@pytest.mark.parametrize("kind", [*FORMATS, "TILES"])
def test_a_bomb_is_refused_before_it_is_decoded(kind, monkeypatch, tmp_path):
    side = 16_000 if kind == "WEBP" else 30_000
    data = with_size(kind, side, side)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(DataError, match=rf"^0\.png is {side} x {side} pixels, more than the 134 million that are read"):
        Decoder().decode(data, "0.png")
    sensor = Folder(write(tmp_path, **{"0__png": data}))
    with pytest.raises(DataError, match=r"more than the 134 million .*; replace it, or .*sensor\.on_bad_image=skip"):
        next(sensor.frames(sensor.plan(RecordedPoses())))
    with pytest.raises(DataError, match=r"none of the images looked at can be read: 0\.png is \d+ x \d+ pixels"):
        check([str(tmp_path), "-o", str(tmp_path.parent / "c.png")])


@pytest.mark.parametrize("kind", [b"IDAT", b"fcTL", b"fdAT", b"iCCP", b"tEXt"])
def test_a_chunk_longer_than_its_file_is_not_made_room_for(kind, monkeypatch):
    data = png(64, 48)
    at = data.index(b"IDAT") - 4
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(DataError, match=r"^x\.png is truncated or no image"):
        Decoder().decode(data[:at] + struct.pack(">I", 2**31 - 1) + kind + data[at:], "x.png")


def test_large_photographs_of_today_are_within_the_bound():
    assert MOST_PIXELS >= 11968 * 5984  # of a 360-degree camera of 72 megapixels
    for size in ((11968, 5984), (16384, 8192)):
        assert Decoder()._header(with_size("PNG", *size), "x").width == size[0]


def test_large_images_are_looked_at_reduced_and_found_in_their_own_pixels(tmp_path, monkeypatch, capsys):
    """The circle of a picture that is reduced by 3 is the one that is there."""
    v, u = np.indices((300, 361))
    inside = np.hypot(u - 190.0, v - 140.0) <= 120
    for i in range(4):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.where(inside, np.clip(texture(i, inside.shape), 60, 255), 3))
    (tmp_path / "positions.csv").write_text(
        "image,x_m,y_m\n" + "".join(f"{i}.png,{i % 2},{i // 2}\n" for i in range(4))
    )
    exact = Folder(tmp_path).optics.camera.circle
    monkeypatch.setattr("omnilab_recordings.images.decoding.REDUCED", 300 * 361 // 7)
    sensor = Folder(tmp_path)
    assert next(iter(sensor.sample.values())).pixels.shape == (100, 120)
    found = sensor.optics.camera.circle
    assert (found.cx, found.cy, found.radius) == pytest.approx((190, 140, 120), abs=2)
    assert (exact.cx, exact.cy, exact.radius) == pytest.approx((190, 140, 120), abs=1)
    assert "4 images, 361 x 300 pixels" in findings(tmp_path, capsys)
    assert read_all(sensor).shape == (4, 300, 361)


def test_large_images_are_handed_over_a_few_at_a_time(write_grid, monkeypatch):
    monkeypatch.setattr("omnilab_recordings.folder.MOST_BYTES", 3 * 20 * 24)
    sensor = Folder(write_grid(5, 2))
    assert [len(frames) for frames in sensor.frames(sensor.plan(RecordedPoses()))] == [3, 3, 3, 1]
    assert [len(f) for f in Folder(write_grid(5, 2), color=True).frames(sensor.plan(RecordedPoses()))] == [1] * 10


def test_a_tiff_whose_pages_go_round_in_circles():
    data = bytearray(tiff([(256, 4, 64), (257, 4, 48), (258, 3, 8)]))
    data[-4:] = struct.pack("<I", 8)
    assert read_header(bytes(data), "x").pages == 1


# --------------------------------------------------------------------------------------------------------------- damage
def broken_jpeg(how):
    data = encoded(texture(shape=(200, 200)), "JPEG")
    half = len(data) // 2
    return {
        "a piece is missing": data[:half] + data[half + 50 :],
        "zeros": data[:half] + bytes(60) + data[half + 60 :],
        "a foreign marker": data[:half] + b"\xff\xd3" + data[half + 2 :],
        "noise": data[:half] + np.random.default_rng(1).bytes(200).replace(b"\xff", b"x") + data[half + 200 :],
    }[how]


@pytest.mark.parametrize("how", ["a piece is missing", "zeros", "a foreign marker", "noise"])
def test_broken_data_inside_a_whole_jpeg_are_a_sentence(tmp_path, capfd, how):
    write(tmp_path, a__jpg=encoded(texture(shape=(200, 200)), "JPEG"), b__jpg=broken_jpeg(how))
    with pytest.raises(DataError, match=r"^b\.jpg is damaged: its JPEG data are broken.*; replace it, or .*=skip$"):
        read_all(Folder(tmp_path))
    assert len(read_all(Folder(tmp_path, on_bad_image=OnBadImage.skip))) == 1
    shown = capfd.readouterr()
    assert shown.err == ""
    assert "b.jpg is damaged" in findings(tmp_path, capfd)


def test_filling_before_the_end_of_a_jpeg_is_no_damage(caplog, tmp_path, capfd):
    data = encoded(texture(), "JPEG")
    write(tmp_path, a__jpg=data[:-2] + bytes(40) + data[-2:], b__jpg=data + bytes(500))
    assert len(read_all(Folder(tmp_path))) == 2
    assert warnings_of(caplog) == []
    assert capfd.readouterr().err == ""


def test_a_few_stray_bytes_in_a_jpeg_are_said(caplog, tmp_path, capfd):
    data = encoded(texture(), "JPEG")
    write(tmp_path, a__jpg=data[:-2] + b"abc" + data[-2:])
    assert len(read_all(Folder(tmp_path))) == 1
    assert "images may be damaged, their JPEG data have bytes that belong to no pixel" in warnings_of(caplog)[0]
    assert capfd.readouterr().err == ""


def test_a_second_picture_behind_a_jpeg_is_no_damage():
    """As phones append depth and gain maps, and cameras previews."""
    data = encoded(texture(), "JPEG")
    both = Decoder().decode(data + encoded(texture(1), "JPEG"), "x")
    assert np.array_equal(both.pixels, Decoder().decode(data, "x").pixels)
    assert not both.stray_bytes


def test_a_thumbnail_does_not_stand_in_for_the_end_of_a_jpeg():
    thumbnail = encoded(texture(shape=(8, 8)), "JPEG")
    data = encoded(texture(), "JPEG")
    block = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 8) + b"Exif\0\0" + thumbnail
    whole = data[:2] + block + data[2:]
    assert Decoder().decode(whole, "x").shape == (48, 64)
    with pytest.raises(DataError, match=r"x is truncated: its JPEG data have no end"):
        Decoder().decode(whole[:-2], "x")


@pytest.mark.parametrize("compression", ["tiff_lzw", "jpeg"])
def test_broken_data_inside_a_whole_tiff(compression, capfd):
    data = bytearray(encoded(texture(shape=(200, 200)), "TIFF", compression=compression))
    at = len(data) // 2
    data[at : at + 200] = bytes(200)
    with pytest.raises(DataError, match=r"^a\.tif is damaged: its TIFF data are broken"):
        Decoder().decode(bytes(data), "a.tif")
    assert capfd.readouterr().err == ""


def test_what_libraries_say_of_whole_images_is_not_shown(capfd):
    data = encoded(texture(), "PNG", icc_profile=b"no profile" * 20)
    assert np.array_equal(Decoder().decode(data, "x").pixels, texture())
    assert capfd.readouterr().err == ""


def test_many_threads_blame_the_right_image(tmp_path, capfd):
    good, bad = encoded(texture(shape=(200, 200)), "JPEG"), broken_jpeg("a piece is missing")
    write(tmp_path, **{f"{i:02}__jpg": bad if i % 7 == 3 else good for i in range(40)})
    sensor = Folder(tmp_path, on_bad_image=OnBadImage.skip)
    omitted = [name.split()[0] for frames in sensor.frames(sensor.plan(RecordedPoses())) for name in frames.omitted]
    assert omitted == [f"{i:02}.jpg" for i in range(40) if i % 7 == 3]
    assert capfd.readouterr().err == ""


def test_what_others_write_meanwhile_is_passed_on(capfd, monkeypatch):
    from omnilab_recordings.images.library_output import LIBRARY_OUTPUT

    def call():
        os.write(2, b"progress: 12 %\nCorrupt JPEG data: premature end of data segment\n")
        return 7

    assert LIBRARY_OUTPUT.of(call) == (7, "Corrupt JPEG data: premature end of data segment")
    assert set(capfd.readouterr().err.splitlines()) == {"progress: 12 %"}
    with monkeypatch.context() as without:
        without.setattr(os, "dup", lambda *_: (_ for _ in ()).throw(OSError))  # no standard error
        assert LIBRARY_OUTPUT.of(lambda: 8) == (8, "")
