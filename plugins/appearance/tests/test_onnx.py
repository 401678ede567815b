"""A learned descriptor, with a network built here whose outputs are known."""

from __future__ import annotations

import pickle
import sys

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_descriptor
from omnilab_appearance import Onnx
from omnilab_appearance.descriptors.onnx import Order

RNG = np.random.default_rng(9)
PANORAMAS = RNG.integers(0, 256, (3, 128, 512, 3), dtype=np.uint8)
PLAIN = {"height": 16, "width": 64, "mean": [0.0, 0.0, 0.0], "std": [1.0, 1.0, 1.0], "normalize": False}


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """A convolution of 4 filters of 3 x 3, and the mean over the picture."""
    weights = RNG.standard_normal((4, 3, 3, 3)).astype(np.float32)
    graph = helper.make_graph(
        [
            helper.make_node("Conv", ["picture", "weights"], ["features"], kernel_shape=[3, 3], pads=[1, 1, 1, 1]),
            helper.make_node("GlobalAveragePool", ["features"], ["pooled"]),
            helper.make_node("Flatten", ["pooled"], ["vector"]),
        ],
        "tiny",
        [helper.make_tensor_value_info("picture", TensorProto.FLOAT, [1, 3, 16, 64])],
        [
            helper.make_tensor_value_info("pooled", TensorProto.FLOAT, [1, 4, 1, 1]),
            helper.make_tensor_value_info("vector", TensorProto.FLOAT, [1, 4]),
        ],
        [helper.make_tensor("weights", TensorProto.FLOAT, weights.shape, weights.ravel())],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    file = tmp_path_factory.mktemp("onnx") / "tiny.onnx"
    onnx.save(model, str(file))
    return str(file), weights


def expected(pictures, weights):
    """The network's output by hand, of pictures (N, 16, 64, 3) in [0, 1]."""
    padded = np.pad(pictures, ((0, 0), (1, 1), (1, 1), (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))  # N, H, W, C, 3, 3
    return np.einsum("nhwcij,ocij->no", windows, weights) / (16 * 64)


def small(pictures):
    return np.stack([cv2.resize(p, (64, 16), interpolation=cv2.INTER_AREA) for p in pictures]) / 255.0


def test_the_contract(network):
    check_descriptor(Onnx(network[0], height=16, width=64))


@pytest.mark.parametrize("order", [Order.rgb, Order.bgr])
def test_the_output_is_the_networks(network, order):
    file, weights = network
    found = Onnx(file, **PLAIN, order=order).describe(PANORAMAS).place
    pictures = small(PANORAMAS)
    np.testing.assert_allclose(
        found, expected(pictures if order is Order.rgb else pictures[..., ::-1], weights), atol=1e-4
    )


def test_inputs_are_normalised_and_outputs_brought_to_unit_length(network):
    file, weights = network
    settings = PLAIN | {"mean": [0.1, 0.2, 0.3], "std": [0.5, 0.4, 0.3], "normalize": True}
    place = expected((small(PANORAMAS) - [0.1, 0.2, 0.3]) / [0.5, 0.4, 0.3], weights)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    np.testing.assert_allclose(Onnx(file, **settings).describe(PANORAMAS).place, place, atol=1e-4)


def test_another_output_can_be_named(network):
    place = Onnx(network[0], **PLAIN, output="pooled").describe(PANORAMAS).place
    np.testing.assert_allclose(place.reshape(3, 4), expected(small(PANORAMAS), network[1]), atol=1e-4)


def test_it_pickles_after_it_has_run(network):
    descriptor = Onnx(network[0], **PLAIN)
    before = descriptor.describe(PANORAMAS).place
    again = pickle.loads(pickle.dumps(descriptor))
    np.testing.assert_array_equal(again.describe(PANORAMAS).place, before)


def test_what_is_no_network(tmp_path, network):
    with pytest.raises(DataError, match=r"cannot be read .No such file or directory.; give descriptor.model=FILE"):
        Onnx(str(tmp_path / "absent.onnx")).describe(PANORAMAS)
    (tmp_path / "text.onnx").write_text("hello")
    with pytest.raises(DataError, match="is no ONNX file that can be run"):
        Onnx(str(tmp_path / "text.onnx")).describe(PANORAMAS)
    gray = Onnx(network[0], **PLAIN | {"order": Order.gray, "mean": [0.0], "std": [1.0]})
    with pytest.raises(DataError, match=r"takes an input of \[1, 3, 16, 64\], not \[1, 1, 16, 64\]"):
        gray.describe(PANORAMAS[..., 0])
    with pytest.raises(DataError, match=r"not \[1, 3, 20, 64\]"):
        Onnx(network[0], **PLAIN | {"height": 20}).describe(PANORAMAS)
    with pytest.raises(DataError, match="has no output 'nothing'; it has pooled, vector"):
        Onnx(network[0], **PLAIN, output="nothing").describe(PANORAMAS)


@pytest.mark.parametrize(
    "settings", [{"mean": [0.5]}, {"std": [0.0, 1, 1]}, {"order": Order.gray}, {"height": 0}], ids=repr
)
def test_settings_that_do_not_fit(settings):
    with pytest.raises(ConfigError, match="give"):
        Onnx("x.onnx", **settings)


def test_without_the_runtime_it_says_what_to_install(network, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ConfigError, match=r"pip install 'omnilab-appearance\[onnx\]'"):
        Onnx(network[0]).describe(PANORAMAS)
