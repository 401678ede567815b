"""Frames of videos by number: exact wherever decoding begins, at the times of the container, damage told."""

import random
from itertools import islice, pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from omnilab.errors import ConfigError, DataError
from omnilab_recordings.video.container import open_file
from omnilab_recordings.video.index import index_of
from omnilab_recordings.video.pixels import LumaRange, image_of
from omnilab_recordings.video.reader import FrameReader

H264 = {"codec": "libx264", "pix_fmt": "yuv420p", "gop": 15, "b_frames": 3}
QUIET = {"x264-params": "log-level=none"}
KINDS = {
    "b.mp4": H264 | {"options": QUIET},
    "open.mkv": H264 | {"options": {"x264-params": "log-level=none:open-gop=1"}},
    "b.ts": H264 | {"options": QUIET},
    "bare.h264": H264 | {"options": QUIET},
    "h264.avi": H264 | {"options": QUIET},
    "265.mp4": {"codec": "libx265", "pix_fmt": "yuv420p", "gop": 15, "options": {"x265-params": "log-level=none"}},
    "mpeg4.avi": {"codec": "mpeg4", "pix_fmt": "yuv420p", "gop": 12, "b_frames": 2},
    "mpeg2.mpg": {"codec": "mpeg2video", "pix_fmt": "yuv420p", "gop": 12, "b_frames": 2},
    "vp9.webm": {"codec": "libvpx-vp9", "pix_fmt": "yuv420p", "gop": 100},
    "ffv1.mkv": {"codec": "ffv1", "pix_fmt": "gray"},
    "mjpeg.avi": {"codec": "mjpeg", "pix_fmt": "yuvj420p"},
}


def read(file, frames=None, **settings):
    index = index_of(file)
    return list(FrameReader(file, index, **settings).pictures(range(len(index)) if frames is None else frames))


@pytest.mark.parametrize("name", KINDS)
def test_random_frames_are_those_of_decoding_in_order(write_video, pictures, name):
    file = write_video(name, pictures(), **KINDS[name])
    with av.open(str(file)) as container:  # as the library decodes it, from the beginning to the end
        expected = [image_of(frame, False, LumaRange.auto) for frame in container.decode(video=0)]
    assert len(expected) == 40
    chosen = [*random.Random(1).sample(range(40), 20), 39, 0, 38, 38]
    assert np.array_equal(read(file), expected)
    assert np.array_equal(read(file, chosen), [expected[i] for i in chosen])
    assert np.array_equal(read(file, range(3, 40, 9)), expected[3::9])


@pytest.mark.parametrize(
    ("name", "codec", "pix_fmt"),
    [("a.mkv", "ffv1", "gray"), ("b.avi", "rawvideo", "gray"), ("c.mkv", "ffv1", "gray10le")],
)
def test_lossless_grey_comes_back_bit_for_bit(write_video, pictures, name, codec, pix_fmt):
    images = pictures(5)
    assert np.array_equal(read(write_video(name, images, codec, pix_fmt)), images)


@pytest.mark.parametrize(("codec", "pix_fmt"), [("ffv1", "bgr0"), ("libx264rgb", "rgb24")])
def test_lossless_colours_come_back_bit_for_bit(write_video, pictures, codec, pix_fmt):
    images = [np.stack([image, image[::-1], 255 - image], -1) for image in pictures(5)]
    options = {"qp": "0", "x264-params": "log-level=none"} if codec == "libx264rgb" else {}
    file = write_video("a.mkv", images, codec, pix_fmt, options=options)
    assert np.array_equal(read(file, color=True), images)


def test_limited_luma_is_stretched_and_full_luma_is_not():
    luma = np.arange(256, dtype=np.uint8).reshape(16, 16)
    frame = av.VideoFrame.from_ndarray(luma, format="gray").reformat(format="yuv420p")
    plane = np.frombuffer(frame.planes[0], np.uint8).reshape(16, -1)
    plane.flags.writeable = True
    plane[:, :16] = luma
    stretched = np.clip(np.rint((luma.astype(float) - 16) * 255 / 219), 0, 255)
    assert np.array_equal(
        image_of(frame, False, LumaRange.auto), stretched
    )  # nothing is said: limited, as players have it
    assert np.array_equal(image_of(frame, False, LumaRange.limited), stretched)
    assert np.array_equal(image_of(frame, False, LumaRange.full), luma)
    for form in ("yuv420p10le", "yuyv422", "nv12", "p010le"):
        assert np.abs(image_of(frame.reformat(format=form), False, LumaRange.limited) - stretched).max() <= 1


def test_rgb_of_luma_and_chroma_is_that_of_the_standard(write_video):
    """Rec. 601 and, from 720 rows on, Rec. 709."""
    for rows, (kr, kb) in ((64, (0.299, 0.114)), (720, (0.2126, 0.0722))):
        frame = av.VideoFrame(16, rows, "yuv444p")
        for plane, value in zip(frame.planes, (120, 90, 170), strict=True):
            plane.update(bytes([value]) * plane.buffer_size)
        y, cb, cr = (120 - 16) / 219, (90 - 128) / 224, (170 - 128) / 224
        r, b = y + 2 * (1 - kr) * cr, y + 2 * (1 - kb) * cb
        expected = 255 * np.array([r, (y - kr * r - kb * b) / (1 - kr - kb), b])
        assert np.abs(image_of(frame, True, LumaRange.auto) - expected).max() <= 1.5


def test_times_are_those_of_the_file_though_they_vary(write_video, pictures):
    times_ms = [0, 33, 66, 140, 141, 500, 533]
    index = index_of(write_video("a.mkv", pictures(7), times_ms=times_ms))
    assert index.stamps_ns.tolist() == [1_000_000 * t for t in times_ms]
    assert "1 to 359 ms apart, mostly 33" in index.remarks["varying"]
    even = index_of(write_video("b.mkv", pictures(7), rate=30))
    assert "varying" not in even.remarks  # the file rounds to whole milliseconds
    assert np.abs(even.stamps_ns - np.arange(7) * 1e9 / 30).max() <= 5e5


def test_a_stream_without_times_is_taken_to_be_even(write_video, pictures):
    index = index_of(write_video("a.h264", pictures(8), **H264, options=QUIET))
    assert "holds no times: its frames are taken to be 40 ms apart" in index.remarks["times"]
    assert np.array_equal(index.stamps_ns, np.arange(8) * 40_000_000)


def test_times_that_contradict_the_coding_are_those_of_the_frames_as_the_decoder_shows_them(
    write_video, pictures, tmp_path
):
    """Some programs write the times of decoding where those of showing belong."""
    sound, wrong = write_video("a.mp4", pictures(), **KINDS["b.mp4"]), tmp_path / "wrong.mp4"
    with av.open(str(sound)) as source, av.open(str(wrong), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.size:
                packet.dts += 2048  # from 0 on
                packet.pts, packet.stream = packet.dts, stream
                container.mux(packet)
    assert np.array_equal(read(wrong), read(sound))
    assert np.array_equal(read(wrong, [30, 7, 8]), [read(sound)[i] for i in (30, 7, 8)])
    assert (np.diff(index_of(wrong).stamps_ns) > 0).all()


def test_when_it_was_begun_is_read_and_a_clock_that_was_never_set_is_not(write_video, pictures):
    assert (
        index_of(
            write_video("a.mp4", pictures(2), **H264, options=QUIET, creation_time="2024-05-01T10:00:00Z")
        ).created_ns
        == 1714557600 * 10**9
    )
    assert (
        index_of(
            write_video("b.mp4", pictures(2), **H264, options=QUIET, creation_time="1970-01-01T00:00:00Z")
        ).created_ns
        is None
    )
    assert index_of(write_video("c.mp4", pictures(2), **H264, options=QUIET)).created_ns is None


def test_a_video_that_is_to_be_turned_is_turned(write_video, pictures, tmp_path):
    plain = write_video("a.mp4", pictures(3), **H264, options=QUIET)
    turned = tmp_path / "turned.mp4"
    with av.open(str(plain)) as source, av.open(str(turned), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        stream.set_display_rotation(90)
        for packet in source.demux(video=0):
            if packet.size:
                packet.stream = stream
                container.mux(packet)
    expected = read(plain)
    assert index_of(turned).rotation_deg == 90
    assert np.array_equal(read(turned), [np.rot90(image) for image in expected])
    assert np.array_equal(read(turned, upright=False), expected)


# --------------------------------------------------------------------------------------------------------------- damage
@pytest.mark.parametrize(("name", "lost"), [("ffv1.mkv", 4), ("b.mp4", 12), ("mjpeg.avi", 1)])
def test_damaged_frames_are_left_out_and_no_other_is_changed(write_video, pictures, damage, name, lost):
    file = write_video(name, pictures(), **KINDS[name])
    before = read(file)
    damage(file, 20)
    after = read(file)
    bad = [i for i, found in enumerate(after) if isinstance(found, str)]
    assert 0 < len(bad) <= lost
    assert all(b - a <= 2 for a, b in pairwise(bad))  # up to the next key frame
    assert all(np.array_equal(found, before[i]) for i, found in enumerate(after) if i not in bad)
    assert f"{name}#{bad[0]}, at {bad[0] / 20:.3f} s, " in after[bad[0]]
    shuffled = random.Random(2).sample(range(40), 40)
    again = dict(zip(shuffled, read(file, shuffled), strict=True))
    assert [i for i in range(40) if isinstance(again[i], str)] == bad


def test_a_file_that_was_cut_short_is_read_as_far_as_it_goes(write_video, pictures):
    file = write_video("a.mkv", pictures(), "mjpeg", "yuvj420p")
    whole = read(file)
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    part = [found for found in read(file) if not isinstance(found, str)]
    assert 10 < len(part) < 30
    assert np.array_equal(part, whole[: len(part)])


# ------------------------------------------------------------------------------------------------------------ bad input
def test_what_is_no_video_is_told_in_a_sentence(write_video, pictures, tmp_path):
    text = tmp_path / "a.mp4"
    text.write_text("no video\n" * 100)
    with pytest.raises(DataError, match=r"a.mp4 is no video that is read, or its header is damaged"):
        index_of(text)
    with pytest.raises(DataError, match=r"cannot be read .No such file or directory.; give sensor.path=FILE"):
        index_of(tmp_path / "none.mp4")
    with pytest.raises(DataError, match="cannot be read"):
        open_file(tmp_path)
    with pytest.raises(ConfigError, match=r"stream=2 is not in .*, which has 1"):
        open_file(write_video("b.mkv", pictures(2)), 2)


def test_a_file_of_sound_alone_has_no_video_stream(tmp_path):
    file = tmp_path / "sound.mka"
    with av.open(str(file), "w", format="matroska") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        sound.rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode())
    with pytest.raises(DataError, match=r"has no video stream \(but audio\)"):
        index_of(file)


def test_a_video_without_frames_is_refused(tmp_path):
    file = tmp_path / "empty.avi"
    with av.open(str(file), "w") as container:
        stream = container.add_stream("rawvideo", rate=20)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "gray"
        container.start_encoding()
    with pytest.raises(DataError, match=r"without a single frame|no frame that can be decoded|no video that is read"):
        index_of(file)


@pytest.mark.parametrize("playlist", ["#EXTM3U\n#EXTINF:1,\nsecret.ts\n", "ffconcat version 1.0\nfile secret.ts\n"])
def test_playlists_which_lead_to_other_files_are_not_followed(write_video, pictures, tmp_path, playlist):
    write_video("secret.ts", pictures(3), **H264, options=QUIET)
    for name in ("list.m3u8", "list.mp4"):
        (tmp_path / name).write_text(playlist)
        with pytest.raises(DataError, match="no video that is read"):
            index_of(tmp_path / name)


def test_pictures_beyond_bounds_are_not_decoded(write_video, pictures, monkeypatch):
    file = write_video("a.mkv", pictures(2))
    monkeypatch.setattr("omnilab_recordings.video.container.MOST_PIXELS", 1000)
    with pytest.raises(DataError, match="no frame that can be decoded: it is damaged, larger than 134 million pixels"):
        index_of(file)


# --------------------------------------------------------------------------------------------------------- other people's
OTHERS = sorted(Path("/usr/share/doc/opencv-doc/examples/data").glob("*.avi"))


@pytest.mark.skipif(not OTHERS, reason="OpenCV's examples, Debian's package opencv-doc, are not installed")
def test_videos_that_others_wrote_are_read_as_the_library_decodes_them():
    """MPEG-4, Microsoft's and Cinepak."""
    for file in OTHERS:
        with av.open(str(file)) as container:
            expected = [image_of(frame, False, LumaRange.auto) for frame in islice(container.decode(video=0), 60)]
        assert np.array_equal(read(file, range(60)), expected)
        assert np.array_equal(read(file, [40, 11, 59]), [expected[i] for i in (40, 11, 59)])
