"""How files become pixels: orientation, bits, pages, transparency, depth maps; run and `omnilab check` say it."""

from __future__ import annotations

import io
import os
import struct

import cv2
import numpy as np
import pytest
from PIL import Image

from omnilab.api import RecordedPoses
from omnilab.errors import ConfigError, DataError
from omnilab_recordings import Folder
from omnilab_recordings.checks.command import check
from omnilab_recordings.folder import OnBadImage
from omnilab_recordings.images.decoding import Decoder
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


def with_orientation(pixels, kind, tag):
    if kind == "TIFF":
        return encoded(pixels, kind, tiffinfo={274: tag})
    exif = Image.Exif()
    exif[274] = tag
    return encoded(pixels, kind, exif=exif)


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


# ---------------------------------------------------------------------------------------------------------- orientation
def stored_as(upright, tag):
    """The pixels of which a viewer that heeds the tag makes the upright picture."""
    turned = {2: np.fliplr, 3: lambda a: np.rot90(a, 2), 4: np.flipud, 5: np.transpose}
    turned |= {6: np.rot90, 7: lambda a: np.rot90(a, 2).T, 8: lambda a: np.rot90(a, -1)}
    return np.ascontiguousarray(turned[tag](upright)) if tag in turned else upright


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF", "WEBP"])
@pytest.mark.parametrize("tag", range(1, 9))
def test_pictures_are_upright_as_viewers_show_them(kind, tag):
    upright = texture()
    data = with_orientation(stored_as(upright, tag), kind, tag)
    applied, stored = (Decoder(exif_orientation=choice).decode(data, "x").pixels for choice in (True, False))
    worst = 8 if kind == "JPEG" else 0
    assert np.abs(applied.astype(int) - upright).max() <= worst
    assert np.abs(stored.astype(int) - stored_as(upright, tag)).max() <= worst
    colored = Decoder(color=True).decode(data, "x").pixels
    assert np.abs(colored.astype(int) - upright[..., None]).max() <= worst
    if kind != "TIFF":  # an independent viewer
        assert np.abs(cv2.imdecode(np.frombuffer(data, np.uint8), 0).astype(int) - applied).max() <= worst


@pytest.mark.parametrize("tag", [0, 9, 77, 65535])
def test_an_orientation_that_is_none_is_upright(tag):
    assert read_header(with_orientation(texture(), "JPEG", tag), "x").orientation == 1


def test_files_of_different_orientations_look_alike_and_that_is_said(tmp_path, caplog, capsys):
    upright = texture(shape=(64, 64))
    tags = [1, 6, 3, 8, 1, 6]
    write(
        tmp_path, **{f"{i}__jpg": with_orientation(stored_as(upright, tag), "JPEG", tag) for i, tag in enumerate(tags)}
    )
    images = read_all(Folder(tmp_path))
    assert np.abs(images.astype(int) - upright).max() <= 8
    (sentence,) = warnings_of(caplog)
    assert "images are turned as their EXIF tags say" in sentence
    assert sentence.endswith(": 2.jpg (tag 3), 1.jpg (tag 6), 3.jpg (tag 8), ...")
    assert "(4 of 6)" in findings(tmp_path, capsys)
    caplog.clear()
    stored = read_all(Folder(tmp_path, exif_orientation=False))  # what the sentence proposes
    assert np.abs(stored[2].astype(int) - upright[::-1, ::-1]).max() <= 8
    assert warnings_of(caplog) == []
    assert "EXIF" not in findings(tmp_path, capsys, "--ignore-exif-orientation")


def test_orientation_makes_sizes_agree(tmp_path):
    upright = texture()
    write(tmp_path, a__jpg=encoded(upright, "JPEG"), b__jpg=with_orientation(stored_as(upright, 6), "JPEG", 6))
    assert read_all(Folder(tmp_path)).shape == (2, 48, 64)
    with pytest.raises(DataError, match=r"b\.jpg is 48 x 64 pixels, the recording 64 x 48"):
        read_all(Folder(tmp_path, exif_orientation=False))


def test_keys_tell_how_files_are_read(tmp_path):
    root = write(tmp_path, a__jpg=with_orientation(texture(), "JPEG", 3))

    def key(**settings):
        sensor = Folder(root, **settings)
        return next(sensor.frames(sensor.plan(RecordedPoses()))).keys[0]

    assert len({key(), key(exif_orientation=False), key(color=True), key(bits=12)}) == 4


# ----------------------------------------------------------------------------------------------------------------- bits
def deep(white, kind="PNG"):
    """An image of 16 bits from black to `white`, and its grey levels."""
    values = np.linspace(0, white, 48 * 64).astype(np.uint16).reshape(48, 64)
    if kind == "P5":
        return b"P5\n64 48\n%d\n" % white + (
            values.astype(">u2") if white > 255 else values.astype(np.uint8)
        ).tobytes(), values
    if kind == "P2":
        return b"P2\n64 48\n%d\n" % white + " ".join(map(str, values.ravel())).encode() + b"\n", values
    return encoded(values, kind), values


@pytest.mark.parametrize("kind", ["P5", "P2"])
@pytest.mark.parametrize("white", [7, 100, 254, 255, 256, 1023, 4095, 16383, 65535])
def test_netpbm_is_scaled_by_what_it_declares_to_be_white(kind, white):
    data, values = deep(white, kind)
    levels = Decoder().decode(data, "x.pgm").pixels
    assert np.abs(levels - values * (255 / white)).max() <= 1.001
    assert levels.max() == 255


def test_colours_of_12_bits():
    values = np.array([[[0, 2047, 4095]] * 9] * 8, ">u2")
    assert Decoder(color=True).decode(b"P6 9 8 4095\n" + values.tobytes(), "x").pixels[0, 0].tolist() == [0, 127, 255]


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
@pytest.mark.parametrize(("bits", "white"), [(10, 1023), (12, 4095), (14, 16383)])
def test_few_bits_in_16_are_said_and_a_setting_scales_them(tmp_path, caplog, capsys, kind, bits, white):
    data, values = deep(white, kind)
    write(tmp_path, **{f"{i}__{kind[:3]}": data for i in range(3)})
    assert read_all(Folder(tmp_path)).max() == white >> 8
    (sentence,) = warnings_of(caplog)
    assert f"none above {white} (white is 65535) and come out dark, with grey levels up to {white >> 8}" in sentence
    assert sentence.endswith(f"if the camera has {bits} bits, give sensor.bits={bits}")
    assert f"give sensor.bits={bits}" in findings(tmp_path, capsys)
    caplog.clear()
    assert np.abs(read_all(Folder(tmp_path, bits=bits)) - values * (255 / white)).max() <= 0.501  # what it proposes
    assert warnings_of(caplog) == []
    assert "sensor.bits" not in findings(tmp_path, capsys, "--bits", str(bits))


def test_the_whole_range_of_16_bits_is_read_as_before(tmp_path, caplog):
    data, values = deep(65535)
    assert np.array_equal(read_all(Folder(write(tmp_path, a__png=data)))[0], values >> 8)
    assert warnings_of(caplog) == []


def test_more_than_the_bits_that_were_given(tmp_path):
    sensor = Folder(write(tmp_path, a__png=deep(5000)[0]), bits=12)
    with pytest.raises(
        DataError, match=r"samples of 5000, more than the 4095 that are white .*\(give sensor\.bits=13\)"
    ):
        read_all(sensor)
    for bits in (7, 17, 0, -1):
        with pytest.raises(ConfigError, match=f"bits={bits} is out of range; give a whole number from 8 to 16"):
            Folder(tmp_path, bits=bits)


def test_tiffs_of_12_bits_are_scaled_too():
    values = np.linspace(0, 4095, 64 * 48).astype(int)
    bits = "".join(f"{value:012b}" for value in values)
    packed = bytes(int(bits[at : at + 8], 2) for at in range(0, len(bits), 8))
    tags = {256: 64, 257: 48, 258: 12, 259: 1, 262: 1, 273: 8 + 2 + 12 * 9 + 4, 277: 1, 278: 48, 279: len(packed)}
    directory = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    image = Decoder().decode(b"II*\0" + struct.pack("<IH", 8, len(tags)) + directory + bytes(4) + packed, "x.tif")
    assert np.abs(image.pixels.ravel() - values * 255 / 4095).max() <= 1.001
    assert image.deep


def test_white_is_zero():
    for dtype, scale in ((np.uint8, 1), (np.uint16, 256)):
        values = texture().astype(dtype) * dtype(scale)
        data = bytearray(encoded(values, "TIFF"))
        header = read_header(bytes(data), "x")
        at = data.index(struct.pack("<HHI", 262, 3, 1)) + 8
        data[at : at + 2] = b"\0\0"
        found = Decoder().decode(bytes(data), "x").pixels
        assert np.abs(255 - texture().astype(int) - found).max() <= 1
        assert not header.inverted


@pytest.mark.parametrize(("dtype", "kind"), [(np.float32, "32-bit floating-point"), (np.int32, "32-bit signed")])
def test_a_tiff_that_holds_no_grey_levels(tmp_path, capfd, dtype, kind):
    data = encoded((texture() / 2).astype(dtype), "TIFF")
    write(tmp_path, **{"0__tiff": data, "1__tiff": data})
    sentence = (
        rf"none of the images .* be read: 0\.tiff holds {kind} samples, .* \(save it with 8 or 16 bits a sample\)"
    )
    with pytest.raises(DataError, match=sentence):
        check([str(tmp_path), "-o", str(tmp_path.parent / "c.png")])
    with pytest.raises(DataError, match=rf"^0\.tiff holds {kind} samples"):
        read_all(Folder(tmp_path))
    assert capfd.readouterr().err == ""


# ---------------------------------------------------------------------------------------------------- pages, depth maps
@pytest.mark.parametrize("kind", ["TIFF", "WEBP", "PNG"])
def test_of_several_pages_the_first_is_read_and_that_is_said(tmp_path, caplog, capsys, kind):
    pages = [Image.fromarray(texture(i)) for i in range(3)]
    data = encoded(pages[0], kind, save_all=True, append_images=pages[1:])
    assert read_header(data, "x").pages == 3
    write(tmp_path, **{f"{i}__{kind[:4]}": data for i in range(2)})
    assert np.array_equal(read_all(Folder(tmp_path))[0], texture())
    (sentence,) = warnings_of(caplog)
    assert sentence.endswith(f"only the first is read: 0.{kind[:4]} (3 pages), ...")
    assert "(3 pages), ... (2 of 2)" in findings(tmp_path, capsys)


def test_pages_beyond_the_sample_are_said_too(write_grid, caplog):
    root = write_grid(10, 10)
    frames = [Image.new("L", (24, 20), 90)] * 2
    (root / "img-5.png").write_bytes(
        encoded(frames[0], "PNG", save_all=True, append_images=[Image.new("L", (24, 20), 9)])
    )
    read_all(Folder(root, circle_px=[10, 10, 8]))
    assert [text.rpartition(": ")[2] for text in warnings_of(caplog)] == ["img-5.png (2 pages)"]


def depth_map(i=0):
    return encoded(np.full((48, 64), 5000 + 3000 * i, np.uint16), "PNG")


def test_depth_maps_among_pictures_are_refused_with_the_pattern_that_leaves_them_out(tmp_path, capsys):
    write(tmp_path / "rgb", **{f"{i}__png": encoded(texture(i), "PNG") for i in range(4)})
    write(tmp_path / "depth", **{f"{i}__png": depth_map(i) for i in range(4)})
    sentence = (
        r"depth/0\.png has 16 bits a sample, as depth maps do, and rgb/0\.png has 8: give sensor\.pattern=rgb/\*$"
    )
    with pytest.raises(DataError, match=sentence):
        read_all(Folder(tmp_path))
    assert "give sensor.pattern=rgb/*" in findings(tmp_path, capsys)
    assert np.array_equal(read_all(Folder(tmp_path, pattern="rgb/*"))[2], texture(2))  # what it proposes
    assert "depth maps" not in findings(tmp_path, capsys, "--pattern", "rgb/*")


def test_depth_maps_beside_their_pictures(tmp_path):
    names = {f"{i}_color__jpg": encoded(texture(i), "JPEG") for i in range(3)} | {
        f"{i}_depth__png": depth_map() for i in range(3)
    }
    with pytest.raises(DataError, match=r"give sensor\.pattern=\*\*/\*\.jpg$"):
        read_all(Folder(write(tmp_path, **names)))
    assert len(read_all(Folder(tmp_path, pattern="**/*.jpg"))) == 3


def test_one_depth_map_beyond_the_sample(write_grid):
    root = write_grid(10, 10)
    (root / "img-5.png").write_bytes(encoded(np.full((20, 24), 30000, np.uint16), "PNG"))
    with pytest.raises(DataError, match=r"^img-5\.png has 16 \(a depth map\?\) bits a sample, the recording 8"):
        read_all(Folder(root, circle_px=[10, 10, 8]))
    sensor = Folder(root, circle_px=[10, 10, 8], on_bad_image=OnBadImage.skip)
    assert len(read_all(sensor)) == 99


# --------------------------------------------------------------------------------------------------------- transparency
@pytest.mark.parametrize("kind", ["PNG", "WEBP", "TIFF"])
def test_what_is_transparent_is_black_and_that_is_said(tmp_path, caplog, capsys, kind):
    grey = texture() // 2 + 60
    alpha = np.full_like(grey, 255)
    alpha[:10], alpha[10:20] = 0, 128
    data = encoded(np.dstack([grey, grey, grey, alpha]), kind)
    write(tmp_path, **{f"0__{kind[:4]}": data})
    expected = np.rint(grey * (alpha / 255))
    for color in (False, True):
        image = read_all(Folder(tmp_path, color=color))[0]
        assert np.abs(image - (expected[..., None] if color else expected)).max() <= 2
    assert "what is transparent in images is read as black: 0." in warnings_of(caplog)[0]
    assert "(1 of 1)" in findings(tmp_path, capsys)


def test_transparency_that_hides_nothing_changes_nothing(tmp_path, caplog):
    bgr = cv2.cvtColor(texture(), cv2.COLOR_GRAY2BGR)
    opaque = np.dstack([bgr, np.full(bgr.shape[:2], 255, np.uint8)])
    write(tmp_path, a__png=encoded(opaque, "PNG"), b__png=encoded(bgr, "PNG"))
    images = read_all(Folder(tmp_path))
    assert np.array_equal(images[0], images[1])
    assert warnings_of(caplog) == []


def test_a_palette_is_looked_up():
    image = Image.fromarray(texture() // 128 * 1, "P")
    image.putpalette([10, 20, 30, 200, 210, 220])
    found = Decoder(color=True).decode(encoded(image, "PNG"), "x").pixels
    assert set(map(tuple, found.reshape(-1, 3).tolist())) == {(10, 20, 30), (200, 210, 220)}
    hidden = Decoder(color=True).decode(encoded(image, "PNG", transparency=bytes([0, 255])), "x")
    assert set(map(tuple, hidden.pixels.reshape(-1, 3).tolist())) == {(0, 0, 0), (200, 210, 220)}
    assert hidden.transparent
