"""One run with a record of each kind, and the reference reader."""

import random
from collections import defaultdict
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from omnilab import api
from omnilab.geometry import planar_poses
from omnilab_mcap import McapSink


@pytest.fixture(scope="session")
def tick():
    return api.Tick(3, 12_345_678_901)


@pytest.fixture(scope="session")
def records(tick):
    """By path, a record of each kind."""
    rng = np.random.default_rng(0)
    places_m = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.0, 0.25, 1.0]])
    vertices_m = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [51, 51, 51]], np.uint8)
    stamps_ns = tick.stamp_ns + np.array([0, 10**8, 2 * 10**8])
    return {
        "camera/image": api.Image(rng.integers(0, 255, (24, 32, 3), np.uint8), "png"),
        "/camera/pose": api.Pose(planar_poses([1.0, 2.0, 3.0], np.pi / 2)[0]),
        "/camera/signature": api.Signature(rng.normal(size=(5, 7)).astype(np.float32)),
        "/places": api.PlaceMap(places_m, np.array([0.0, np.pi / 2, -np.pi / 2])),
        "/sites": api.PlaceMap(places_m),
        "/distances": api.DistanceField(places_m, np.array([0.5, 0.25, 4.0])),
        "/cloud": api.PointCloud(vertices_m, colors),
        "/query": api.Estimate(places_m[0], places_m[1], "second", 0.5, -0.25),
        "/lost": api.Estimate(places_m[0], places_m[1], "wrong"),
        "/answers": api.Answers(places_m, places_m[::-1] + 1.5, ["nearest", "wrong", "nearest"]),
        "/room": api.Mesh(vertices_m, np.array([[0, 1, 2], [0, 2, 3]]), colors),
        "/error": api.Series(np.array([0.5, 0.25, np.inf]), np.array([3, 4, 5]), stamps_ns, "m"),
        "/log": api.Text("the map is ready", "WARN"),
        "progress": api.Progress("describe", 1, 2),
        "/layout": api.ViewLayout([[api.Panel("map", "Room", ["/room"])]]),
    }


@pytest.fixture(scope="session")
def run(tmp_path_factory, records, tick):
    """The run folder: all records, at step 3."""
    folder = tmp_path_factory.mktemp("run")
    sink = McapSink()
    sink.open(folder)
    for path, record in records.items():
        sink.write(path, record, tick)
    sink.close()
    return folder


@pytest.fixture(scope="session")
def read():
    """A function: the messages of a log by topic, as the reference reader and decoder see them."""

    def read(path):
        topics = defaultdict(list)
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                topics[channel.topic].append(SimpleNamespace(schema=schema, message=message, decoded=decoded))
        return topics

    return read


@pytest.fixture(scope="session")
def own(tmp_path_factory):
    """The bytes of a whole log of the sink: 8 chunks of 10 messages, the last 4 on a channel of their own."""
    folder = tmp_path_factory.mktemp("own")
    sink = McapSink()
    sink.open(folder)
    for step in range(80):
        topic = "/log" if step < 40 else "/late"
        sink.write(topic, api.Text(f"step {step} {random.Random(step).randbytes(100).hex()}"), api.Tick(step, step))
        if step % 10 == 9:
            sink.flush()
    sink.close()
    return (folder / "run.mcap").read_bytes()
