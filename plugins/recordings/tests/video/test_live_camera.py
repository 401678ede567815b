"""The sensor `camera`: files as if live, a server on this machine, what is refused, and cameras that go silent."""

import logging
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest

from omnilab.api import GridPoses, RecordedPoses
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_sensor
from omnilab_recordings import LiveCamera, Video

CIRCLE = [47.5, 31.5, 32.0]


def delivered(camera):
    return list(camera.frames(camera.plan(RecordedPoses())))


@pytest.fixture
def server(pictures):
    """Sends pictures as a multipart stream of JPEG, `rate` a second, and then stays silent, or closes."""
    servers = []

    def start(count=12, rate=50, stall_s=0.0, redirect=None):
        images = pictures(count)

        class Stream(BaseHTTPRequestHandler):
            def do_GET(self):
                if redirect and self.path != redirect:
                    self.send_response(302)
                    self.send_header("Location", redirect)
                    self.end_headers()
                    return
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                for image in images:
                    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                    self.wfile.write(head.encode() + data + b"\r\n")
                    self.wfile.flush()
                    time.sleep(1 / rate)
                time.sleep(stall_s)

            def log_message(self, *_):
                pass

        made = ThreadingHTTPServer(("127.0.0.1", 0), Stream)
        made.daemon_threads = True
        threading.Thread(target=made.serve_forever, daemon=True).start()
        servers.append(made)
        return f"http://127.0.0.1:{made.server_port}/stream", images

    yield start
    for made in servers:
        made.shutdown()
        made.server_close()


def test_it_keeps_the_contract_of_sensors(write_video, pictures):
    file = write_video("a.mkv", pictures(4), rate=100)
    check_sensor(LiveCamera(str(file), circle_px=CIRCLE, color=True), RecordedPoses())


def test_a_file_is_played_at_its_own_pace(write_video, pictures, caplog):
    images = pictures(8)
    file = write_video("a.mkv", images, rate=40)
    begin_ns = time.time_ns()
    camera = LiveCamera(str(file), circle_px=CIRCLE, buffer=100)
    with caplog.at_level(logging.WARNING, "omnilab"):
        frames = delivered(camera)
    assert np.array_equal([one.images[0] for one in frames], images)
    assert [int(one.plan_index[0]) for one in frames] == list(range(8))
    stamps = np.array([int(one.stamps_ns[0]) for one in frames])
    assert begin_ns < stamps[0]
    assert (stamps - stamps[0] >= np.arange(8) * 25_000_000 - 2_000_000).all()
    assert "a.mkv ended after 8 of 1000 frames (its end was reached): what came before is kept" in caplog.text
    assert frames[0].T_world_camera is None
    played = Video(str(file), circle_px=CIRCLE)
    (recorded,) = played.frames(played.plan(RecordedPoses()))
    assert [k.rpartition("@")[2] for k in recorded.keys] == [one.keys[0].rpartition("@")[2] for one in frames]


def test_it_ends_after_so_many_frames(write_video, pictures, caplog):
    camera = LiveCamera(str(write_video("a.mkv", pictures(8), rate=100)), circle_px=CIRCLE, count=3, buffer=100)
    with caplog.at_level(logging.WARNING, "omnilab"):
        assert len(delivered(camera)) == 3
    assert "ended" not in caplog.text


def test_who_is_slow_gets_the_newest_frames_and_a_count_of_the_others(write_video, pictures, caplog):
    file = write_video("a.mkv", pictures(20), rate=100)
    camera = LiveCamera(str(file), circle_px=CIRCLE, buffer=1)
    with caplog.at_level(logging.WARNING, "omnilab"):
        seen = []
        for frames in camera.frames(camera.plan(RecordedPoses())):
            seen.append(frames)
            time.sleep(0.05)
    assert 2 <= len(seen) < 20
    assert np.array_equal(seen[-1].images[0], pictures(20)[-1])
    assert f"{20 - len(seen)} frames came while 1 others waited, and were dropped" in caplog.text


def test_a_stream_of_this_machine_is_received(server, caplog):
    address, images = server()
    with caplog.at_level(logging.WARNING, "omnilab"):
        frames = delivered(LiveCamera(address, circle_px=CIRCLE, buffer=100))
    assert len(frames) >= 8  # what shows the format comes too early, and the last may lack its end
    which = [
        [np.abs(found.images[0].astype(int) - image).max() <= 6 for image in images].index(True) for found in frames
    ]
    assert which == list(range(which[0], which[0] + len(frames)))  # but for JPEG's losses
    assert f"ended after {len(frames)} of 1000 frames" in caplog.text


def test_a_stream_that_falls_silent_ends_and_keeps_what_came(server, caplog):
    address, _ = server(count=6, stall_s=3)
    begin = time.monotonic()
    with caplog.at_level(logging.WARNING, "omnilab"):
        frames = delivered(LiveCamera(address, circle_px=CIRCLE, buffer=100, silence_s=0.7))
    assert time.monotonic() - begin < 3
    assert len(frames) >= 4
    assert "what came before is kept" in caplog.text


def test_an_address_leads_to_no_other_one(server):
    address, _ = server(redirect="/elsewhere")
    with pytest.raises(DataError, match="cannot be opened"):
        delivered(LiveCamera(address, circle_px=CIRCLE))


@pytest.mark.parametrize(
    "address", ["http://192.168.1.7/stream", "rtsp://me:secret@camera.example/a", "http://10.0.0.1:80"]
)
def test_other_machines_are_refused_unless_they_are_meant(address):
    with pytest.raises(
        ConfigError, match=r"is not on this machine .* give sensor.allow_network=true if it is meant"
    ) as error:
        LiveCamera(address)
    assert "secret" not in str(error.value)
    LiveCamera(address, allow_network=True)


def test_this_machine_has_several_names():
    for host in ("localhost", "127.0.0.1", "127.8.8.8", "[::1]"):
        LiveCamera(f"rtsp://{host}:8554/cam")


@pytest.mark.parametrize(("path", "message"), [
    ("file:///etc/passwd", "an address of a kind that is not opened"),
    ("concat://a|b", "an address of a kind that is not opened"),
])  # fmt: skip
def test_only_streams_are_addresses(path, message):
    with pytest.raises(ConfigError, match=message):
        LiveCamera(path)


def test_what_is_not_there_is_told_in_a_sentence(tmp_path, server):
    with pytest.raises(DataError, match=r"there is no camera /dev/video97 \(there is: .*\); plug it in"):
        delivered(LiveCamera("97"))
    with pytest.raises(DataError, match="cannot be read"):
        delivered(LiveCamera(str(tmp_path / "none.mp4")))
    with pytest.raises(DataError, match=r"cannot be opened .*; see that it is there"):
        delivered(LiveCamera("http://127.0.0.1:9/none", silence_s=2))
    with pytest.raises(DataError, match="shows what comes, at no pose that is asked for"):
        LiveCamera("0").plan(GridPoses(step_m=1))
