"""Conformance checks for plugin authors: one call in a test, and a component is known to keep the contract.

::

    from omnilab.testing import check_descriptor

    def test_mine():
        check_descriptor(Mine())
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Bytes, Floats, Layout, Places, Signatures, Tick
from omnilab.errors import DataError
from omnilab.geometry import planar_poses, wrap_angle
from omnilab.graphs import arrivals, between, matrices, moved, vectors
from omnilab.projection import PANORAMA_SHAPE, HyperbolicMirror, encode
from omnilab.record import Recorder
from omnilab.registry import check_component

SIDE = 96  # of the pictures that descriptors are tried on


def check_disturbance(disturbance: Any, harmless: Any, color: bool = False) -> None:
    """Shape, type, deterministic by seed, batch equals one by one, input left alone, pickles; on RGB with `color`.

    `harmless` is the same component, set so that it must change nothing.
    """
    _common("disturbance", disturbance)
    images, camera = _pictures("mirror", color), HyperbolicMirror(SIDE)
    before = images.copy()
    first = disturbance.apply(images, camera, _generators())
    _expect(np.array_equal(images, before), "the images that were given are changed")
    _expect(first.shape == images.shape, f"images of shape {images.shape} come back as {first.shape}")
    _expect(first.dtype == np.uint8, f"images come back as {first.dtype}, uint8 is expected")
    again = disturbance.apply(images, camera, _generators())
    _expect(np.array_equal(first, again), "the same seeds give other images the second time")
    single = [disturbance.apply(images[i : i + 1], camera, [rng]) for i, rng in enumerate(_generators())]
    _expect(np.array_equal(first, np.concatenate(single)), "a batch gives other images than its images one by one")
    kept = harmless.apply(images, camera, _generators())
    _expect(np.array_equal(kept, images), "set so that it changes nothing, it changes the images")


def check_descriptor(descriptor: Any) -> None:
    """Shape, type, finite, deterministic, batch equals one by one, rotation as declared, defined on black, pickles."""
    _common("descriptor", descriptor)
    images = _pictures(descriptor.view, descriptor.color)
    if is_learner := isinstance(descriptor, api.Learner):
        learner, descriptor = descriptor, descriptor.fit(images)
        _expect(_same(learner.restore(descriptor.state()).describe(images), descriptor.describe(images), 0),
                "restored from its state, what was learnt gives other signatures")  # fmt: skip
    first = descriptor.describe(images)
    _expect(isinstance(first, Signatures), f"describes images as {type(first).__name__}, not as Signatures")
    for part in (first.place, *([] if first.heading is None else [first.heading])):
        _expect(len(part) == len(images), f"describes {len(images)} images as {len(part)} signatures")
        _expect(part.dtype == np.float32, f"signatures are {part.dtype}, float32 is expected")
        _expect(bool(np.isfinite(part).all()), "signatures hold NaN or infinity")
    _expect(_same(first, descriptor.describe(images), 0), "the same images give other signatures the second time")
    single = [descriptor.describe(images[i : i + 1]) for i in range(len(images))]
    alone = Signatures(np.concatenate([s.place for s in single]))
    _expect(_same(Signatures(first.place), alone, 1e-5), "a batch gives other signatures than its images one by one")
    if not is_learner and getattr(descriptor, "cached", True):
        _check_parts(descriptor, images, first)
    black = descriptor.describe(np.zeros_like(images))
    _expect(bool(np.isfinite(black.place).all()), "black images give NaN or infinity")
    _check_turn(descriptor, images, first)


def _check_parts(descriptor: Any, images: Bytes, whole: Signatures) -> None:
    """What the cache counts on: the rest of a batch changes no bit of an image's signature."""
    for chosen in (slice(0, 1), slice(1, None), slice(0, None, 2)):
        some, same = descriptor.describe(np.ascontiguousarray(images[chosen])), whole[chosen]
        alike = some.heading is None or same.heading is None or np.array_equal(some.heading, same.heading)
        _expect(alike and np.array_equal(some.place, same.place),
                "a part of a batch gives other signatures than the whole, in the last bits; describe image by image, or"
                " say `cached = False`")  # fmt: skip


def _check_turn(descriptor: Any, images: Bytes, before: Signatures) -> None:
    """A quarter turn of the camera moves pixels exactly, so what it does to signatures is known exactly."""
    _expect(
        descriptor.turned in {"shifts", "same", "changes"},
        f"turned={descriptor.turned!r} is none of 'shifts', 'same', 'changes'",
    )
    if descriptor.turned == "changes" and before.heading is None:
        return
    if descriptor.view == "mirror":
        turned = np.rot90(images, k=-1, axes=(1, 2))
    else:
        turned = np.roll(images, -images.shape[2] // 4, axis=2)
    after = descriptor.describe(np.ascontiguousarray(turned))
    if descriptor.turned != "changes":
        expected = _quarter(before.place) if descriptor.turned == "shifts" else before.place
        _expect(
            _same(Signatures(expected), Signatures(after.place), 1e-3),
            f"declares turned={descriptor.turned!r}, but a quarter turn to the left does something else",
        )
    if before.heading is not None:
        _expect(
            _same(Signatures(_quarter(before.heading)), Signatures(after.heading), 1e-3),
            "a quarter turn to the left does not shift the last axis of `heading` by a quarter",
        )


def _quarter(turned: Floats) -> Floats:
    """What a quarter turn to the left makes of an axis that shifts."""
    samples = turned.shape[-1]
    _expect(samples % 4 == 0, f"{samples} angles hold no quarter turn; check a descriptor with a multiple of 4")
    return np.roll(turned, -samples // 4, axis=-1)


def check_distance(distance: Any, signatures: Signatures | None = None) -> None:
    """Shapes, finite, deterministic, chunks agree, a place is nearest to itself, rotations as they should be."""
    _common("distance", distance)
    places = signatures or Signatures(_smooth(np.random.default_rng(5), (12, 24, 36)).astype(np.float32))
    index = distance.prepare(places)
    match = distance.match(places, index)
    count = len(places)
    _expect(match.distance.shape == (count, count), f"distances have shape {match.distance.shape}, not (Q, P)")
    _expect(bool(np.isfinite(match.distance).all()), "distances hold NaN or infinity")
    itself = match.distance.argmin(axis=1)
    _expect(bool((itself == np.arange(count)).all()), "a place is not the nearest to itself")
    again = distance.match(places[:5], index)
    _expect(bool(np.allclose(again.distance, match.distance[:5], rtol=1e-4, atol=1e-4 * match.distance.max())),
            "a part of the queries gives other distances than all of them")  # fmt: skip
    blank = distance.match(Signatures(np.zeros_like(places.place)), index)
    _expect(bool(np.isfinite(blank.distance).all()), "signatures of zeros give NaN or infinity")
    if match.rotation_rad is not None:
        _check_rotation(distance, places, index)


def _check_rotation(distance: Any, places: Signatures, index: Any) -> None:
    samples = places.place.shape[-1]
    for shift in (0, 1, samples // 3, samples - 1):
        turned = Signatures(np.roll(places.place, -shift, axis=-1))  # the camera turned to the left by `shift` samples
        rotation = distance.match(turned, index).rotation_rad.diagonal()
        error = np.angle(np.exp(1j * (rotation - 2 * np.pi * shift / samples)))
        _expect(bool((np.abs(error) < np.pi / samples).all()),
                f"a turn by {shift} of {samples} samples is answered with {np.rad2deg(rotation)} degrees")  # fmt: skip
        _expect(bool((rotation >= -np.pi).all() and (rotation < np.pi).all()), "rotations leave [-pi, pi)")


class _PositionDistance:
    """Signatures that are positions: what a localizer should do with them is plain."""

    def prepare(self, places: Signatures) -> Floats:
        return places.place

    def match(self, queries: Signatures, index: Floats) -> api.Match:
        apart = np.linalg.norm(queries.place[:, None] - index[None], axis=-1).astype(np.float32)
        return api.Match(apart, np.zeros_like(apart))


def check_localizer(localizer: Any) -> None:
    """Shapes, deterministic, a place is found where it is, batch equals one by one."""
    _common("localizer", localizer)
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    position_m = np.stack([x.ravel(), y.ravel(), np.ones(20)], axis=1)
    signatures = Signatures(position_m.astype(np.float32))
    places = Places(signatures, planar_poses(position_m), [str(i) for i in range(20)])
    index = localizer.prepare(places, _PositionDistance())
    found = localizer.locate(signatures, index)
    _expect(found.position_m.shape == (20, 3), f"positions have shape {found.position_m.shape}, not (Q, 3)")
    _expect(bool((found.place == np.arange(20)).all()), "a place is not recognised as itself")
    single = np.concatenate([localizer.locate(signatures[i : i + 1], index).position_m for i in range(20)])
    _expect(bool(np.allclose(single, found.position_m)), "a batch gives other positions than its queries one by one")


def check_map_maker(maker: Any) -> None:
    """Shapes, deterministic, a plane's own distances are kept, infinite ones do not count, batch equals one by one."""
    check_localizer(maker)
    _expect(isinstance(maker, api.MapMaker), "has no `arrange`")
    position = np.random.default_rng(8).uniform(-1, 1, (3, 12, 2))
    given = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
    given[0, 2, 9] = given[0, 9, 2] = np.inf
    before = given.copy()
    made = maker.arrange(given, np.random.default_rng(4), steps=7)
    _expect(np.array_equal(given, before), "the distances that were given are changed")
    _expect(made.position.shape == position.shape, f"positions have shape {made.position.shape}, not (B, n, 2)")
    _expect(made.steps is not None and made.steps.shape[1:] == position.shape, "states on the way are not (S, B, n, 2)")
    _expect(bool(np.allclose(made.steps[-1], made.position)), "the last state on the way is not where they settled")
    _expect(bool((made.iterations >= 0).all()), "iterations are below 0")
    apart = np.linalg.norm(made.position[:, :, None] - made.position[:, None], axis=-1)
    counts = np.isfinite(given)
    misfit = np.sqrt(np.sum((apart - given) ** 2, axis=(1, 2), where=counts))
    misfit /= np.sqrt(np.sum(given**2, axis=(1, 2), where=counts))
    _expect(bool(np.allclose(made.stress, misfit, atol=1e-6)), f"stress is {made.stress}, the positions have {misfit}")
    _expect(bool((misfit < 0.05).all()), f"distances of a plane are kept with a stress of {misfit.max():.3f} only")
    again = maker.arrange(given, np.random.default_rng(4))
    _expect(np.array_equal(again.position, made.position), "the same seed makes another map the second time")
    single = [maker.arrange(given[i : i + 1], np.random.default_rng(4)).position for i in range(len(given))]
    _expect(
        bool(np.allclose(np.concatenate(single), made.position)), "a batch makes other maps than its sets one by one"
    )


def check_altimeter(altimeter: Any) -> None:
    """Shapes, deterministic, one reference for many tests, batch equals one by one, defined on black, pickles."""
    _common("altimeter", altimeter)
    images, camera = _pictures("mirror", color=False), HyperbolicMirror(SIDE)
    first = altimeter.relative(images[:1], images, camera)
    for name in ("value", "confidence", "rotation_rad"):
        _expect(getattr(first, name).shape == (len(images),), f"{name} has not one number for each of the tests")
    _expect(first.unit != "", "heights have no unit; say 'm', or what they count")
    known = np.isfinite(first.value)
    _expect(bool((first.confidence[known] >= 0).all() and (first.confidence <= 1).all()), "confidences leave [0, 1]")
    for curve, values in first.curves.items():
        _expect(len(values) == len(images), f"the curve '{curve}' has not one row for each of the tests")
    each = altimeter.relative(np.repeat(images[:1], len(images), axis=0), images, camera).value
    _expect(
        np.array_equal(each, first.value, equal_nan=True),
        "a reference for each test gives other heights than one for all",
    )
    single = [altimeter.relative(images[:1], images[i : i + 1], camera).value for i in range(len(images))]
    _expect(bool(np.allclose(np.concatenate(single), first.value, equal_nan=True)),
            "a batch gives other heights than its images one by one")  # fmt: skip
    black = altimeter.relative(np.zeros_like(images[:1]), np.zeros_like(images), camera)
    _expect(bool((black.confidence == 0).all()), "black images are told apart with a confidence above 0")


def check_odometry(odometry: Any, frames: api.Frames) -> None:
    """Frames of a short way (N at least 3, with their poses) are looked at one by one as in a batch; motions are sound.

    Deterministic by seed; covariances are positive definite; pickles.
    """
    _common("odometry", odometry)
    looks = odometry.look(frames)
    _expect(len(looks) == len(frames) >= 3, f"{len(frames)} images are looked at as {len(looks)}")
    _expect(not any(isinstance(look, api.Unusable) for look in looks), "images that were said to be good are unusable")
    for before, now in pairwise(looks):
        told = odometry.motion(before, now, np.random.default_rng(1))
        again = odometry.motion(before, now, np.random.default_rng(1))
        _expect(not told.failed, f"the motion between two good images is not told: {told.failed}")
        _expect(told.unit != "", "motions have no unit; say 'm', or what lengths count")
        _expect(np.shape(told.vector) == (3,) and bool(np.isfinite(told.vector).all()), f"a motion is {told.vector}")
        _expect(np.array_equal(told.vector, again.vector), "the same seed gives another motion the second time")
        _expect(np.shape(told.covariance) == (3, 3), f"covariances have shape {np.shape(told.covariance)}, not (3, 3)")
        _expect(bool((np.linalg.eigvalsh(told.covariance) > 0).all()), "covariances are not positive definite")
    (alone,) = odometry.look(frames.at(len(frames) - 1))
    single = odometry.motion(looks[-2], alone, np.random.default_rng(1)).vector
    _expect(bool(np.allclose(single, told.vector)), "an image looked at alone gives another motion than in a batch")


def check_loop_closure(closure: Any, frames: api.Frames) -> None:
    """Nodes are earlier ones, shapes agree, covariances are positive, two memories know nothing of each other; pickles."""
    _common("loop_closure", closure)
    found = []
    for memory in (closure.begin(), closure.begin()):
        rng = np.random.default_rng(1)
        for i in range(len(frames)):
            told = memory.recall(frames.at(i), None, 0.1, rng)
            count = len(told.nodes)
            _expect(i > 0 or count == 0, "the first image is recognised")
            _expect(
                bool((told.nodes < i).all()), f"image {i} is recognised as one that has not come before: {told.nodes}"
            )
            _expect(told.motions.shape == (count, 3), f"motions have shape {told.motions.shape}, not (K, 3)")
            _expect(told.covariances.shape == (count, 3, 3), f"covariances have shape {told.covariances.shape}")
            _expect(told.distances.shape == (count,), f"distances have shape {told.distances.shape}, not (K,)")
            _expect(bool((np.linalg.eigvalsh(told.covariances) > 0).all()), "covariances are not positive definite")
            found.append([*told.nodes.tolist(), *told.motions.ravel().tolist()])
    _expect(found[: len(frames)] == found[len(frames) :], "a second memory answers otherwise than the first")


def check_view_filter(view_filter: Any) -> None:
    """A circle without noise, with views seen truly, is kept exactly; a wrong observation is not believed; pickles.

    Covariances stay symmetric and positive; views are numbered as they come. A view from before tells where the robot is.
    """
    _common("view_filter", view_filter)
    angle = np.linspace(0, 2 * np.pi, 25)
    truth = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), wrap_angle(angle + np.pi / 2)])
    small = np.diag([1e-4, 1e-4, 1e-4])
    _check_known_view(view_filter)
    found = view_filter.begin(truth[0], 1e-6 * np.eye(3))
    kept: list[Floats] = []
    for i in range(1, len(truth)):
        motion = between(truth, np.array([[i - 1, i]]))[0]
        _expect(not found.predict(motion, small), "a plain step goes wrong")
        far = [k for k, view in enumerate(kept) if np.hypot(*(view - truth[i])[:2]) > 0.7]
        if far:
            seen = np.array([_angles(truth[i], kept[k]) for k in far])
            believed, said = found.observe(np.array(far), seen, np.tile(1e-4 * np.eye(2), (len(far), 1, 1)))
            _expect(np.shape(believed) == (len(far),), "it does not say of each observation whether it is believed")
            _expect(bool(np.all(believed)) and not said, f"true observations are not believed: {said}")
        if i % 4 == 0:
            _expect(found.add_view() == len(kept), "views are not numbered as they come")
            kept.append(truth[i])
    views, spreads = found.views(), found.view_covariances()
    pose, spread = found.pose()
    _expect(bool(np.allclose(views[:, :2], np.array(kept)[:, :2], atol=1e-3)), "views are not where they were taken")
    _expect(bool(np.allclose(pose[:2], truth[-1, :2], atol=1e-3)), "the robot is not where it is")
    for one in (spread, *spreads):
        _expect(
            bool(np.allclose(one, one.T) and np.linalg.eigvalsh(one)[0] > 0), "a covariance is not positive definite"
        )
    wrong = _angles(truth[-1], kept[2]) + np.array([1.5, -1.0])
    believed, _ = found.observe(np.array([2]), wrong[None], 1e-4 * np.eye(2)[None])
    _expect(not believed[0], "an observation that is off by a radian is believed")
    way = found.finish()
    _expect(way.shape == truth.shape, f"the way has shape {way.shape}, not (T, 3)")
    _expect(bool(np.allclose(way[:, :2], truth[:, :2], atol=1e-3)), "the way is not the true one")


def _check_known_view(view_filter: Any) -> None:
    """Views from before are where they were said to be, and put right a robot that is unsure of itself."""
    known, small = np.array([[3.0, 2, 0.5], [3, -2, -0.5]]), np.diag([1e-6, 1e-6, 1e-6])
    found = view_filter.begin(np.array([0.1, -0.1, 0.02]), np.diag([0.1, 0.1, 0.02]))
    numbers = [found.know_view(pose, small) for pose in known]
    _expect(numbers == [0, 1], "views from before are not numbered as they come")
    _expect(bool(np.allclose(found.views(), known)), "views from before are not where they were said to be")
    for one in found.view_covariances():
        _expect(bool(np.allclose(one, small)), "views from before are not as sure as they were said to be")
    seen = np.array([_angles(np.zeros(3), pose) for pose in known])
    for _ in range(3):
        found.observe(np.arange(2), seen, np.tile(1e-6 * np.eye(2), (2, 1, 1)))
    _expect(bool(np.allclose(found.pose()[0], 0, atol=0.01)), "views from before do not tell where the robot is")
    _expect(len(found.finish()) == 1, "views from before are taken for poses of the way")


def _angles(robot: Floats, view: Floats) -> Floats:
    """Bearing and relative orientation (2,) of a view (3,) from a robot's pose (3,)."""
    x, y = (view - robot)[:2]
    return np.asarray(wrap_angle([np.arctan2(y, x) - robot[2], view[2] - robot[2]]))


def check_backend(backend: Any) -> None:
    """Perfect motions are met exactly from bad guesses, planar and spatial; the first pose stays; deterministic; pickles.

    Covariances are symmetric and positive; the graph that was given is left alone; one in two parts is refused. One that
    takes poses as they come ends where the others do.
    """
    _common("backend", backend)
    for graph, truth in (_ring(planar=True), _ring(planar=False)):
        before = graph.poses.copy()
        found = backend.optimize(graph, covariances=True)
        _expect(np.array_equal(graph.poses, before), "the poses that were given are changed")
        _expect(
            found.poses.shape == graph.poses.shape, f"poses have shape {found.poses.shape}, not {graph.poses.shape}"
        )
        _expect(bool(np.allclose(matrices(found.poses), matrices(truth), atol=1e-4)), "perfect motions are not met")
        _expect(found.chi2 < 1e-6 < found.chi2_before, f"chi2 goes from {found.chi2_before} to {found.chi2}")
        _expect(found.weights.shape == (len(graph.edges),), "weights are not one for each edge")
        _expect(bool(((found.weights > 0.5) & (found.weights <= 1)).all()), "edges that fit are not trusted")
        d = 3 if graph.planar else 6
        _expect(np.shape(found.covariances) == (len(graph), d, d), f"covariances are {np.shape(found.covariances)}")
        _expect(bool((np.linalg.eigvalsh(found.covariances) > 0).all()), "covariances are not positive definite")
        again = backend.optimize(graph)
        _expect(np.array_equal(again.poses, found.poses), "the same graph gives other poses the second time")
        if isinstance(backend, api.OnlineBackend):
            _check_growing(backend.begin(graph.poses[0]), graph, truth)
    apart = replace(graph, edges=graph.edges[2:], motions=graph.motions[2:], information=graph.information[2:])
    apart = replace(apart, edges=np.where(apart.edges == 1, 2, apart.edges))
    try:
        backend.optimize(apart)
    except DataError:
        return
    raise AssertionError("a graph in two parts is optimised without a word")


def _check_growing(growing: Any, graph: api.PoseGraph, truth: Floats) -> None:
    """Poses come one by one; each is there at once, and all are right at the end."""
    for arrival in arrivals(graph):
        own, guess = arrival.edges, moved(growing.pose(arrival.before), arrival.motion)
        said = growing.add(guess, arrival.ends, graph.motions[own], graph.information[own])
        _expect(not said, f"adding a pose goes wrong: {said}")
        _expect(len(growing.poses()) == arrival.node + 1, "there are not as many poses as were added")
    _expect(bool(np.allclose(matrices(growing.poses()), matrices(truth), atol=1e-4)), "perfect motions are not met")
    number, nowhere = len(graph), np.array([[0, len(graph) + 5]])
    said = growing.add(truth[0], nowhere, graph.motions[:1], graph.information[:1])
    _expect(len(said) > 0, "an edge to a pose that is not there is taken without a word")
    _expect(len(growing.poses()) == number + 1, "an update that failed loses its pose")
    _expect(
        bool(np.allclose(matrices(growing.poses()[:-1]), matrices(truth), atol=1e-3)), "a failed update costs the map"
    )


def _ring(planar: bool) -> tuple[api.PoseGraph, Floats]:
    """Twelve poses on a circle with perfect motions to the next and some across, guessed badly; and the true poses."""
    rng = np.random.default_rng(2)
    angle = np.arange(12) * np.pi / 6
    T = planar_poses(np.column_stack([np.cos(angle), np.sin(angle), 0 * angle if planar else angle / 3]), angle + 1.5)
    pairs = [(i, (i + 1) % 12) for i in range(12)] + [(0, 5), (3, 9), (7, 2)]
    edges = np.array(pairs)
    truth = vectors(T, planar)
    spread = rng.standard_normal((len(edges), truth.shape[1] if planar else 6, truth.shape[1] if planar else 6))
    information = spread @ spread.transpose(0, 2, 1) + 50 * np.eye(spread.shape[1])
    guess = vectors(T @ planar_poses(rng.normal(0, 0.1, (12, 3)) * [1, 1, not planar], rng.normal(0, 0.1, 12)), planar)
    guess[0] = truth[0]
    return api.PoseGraph(np.arange(12), guess, edges, between(truth, edges), information), truth


def check_sensor(sensor: Any, layout: Layout) -> None:
    """A plan as long as its frames, in its order; shapes; deterministic; a part of a plan gives the same images."""
    _common("sensor", sensor)
    plan = sensor.plan(layout)
    _expect(len(plan) > 0, "the layout has no frames, so nothing can be checked")
    _expect(plan.T_world_camera is None or plan.T_world_camera.shape == (len(plan), 4, 4), "poses are not (N, 4, 4)")
    _expect(list(plan.keys) == list(sensor.plan(layout).keys), "the same layout is planned otherwise the second time")
    batches = list(sensor.frames(plan))
    order = np.concatenate([b.plan_index for b in batches])
    _expect(bool((np.diff(order) > 0).all()), "frames do not come in the plan's order")
    _expect(len(order) + sum(len(b.omitted) for b in batches) == len(plan), "frames are missing without a word")
    for batch in batches:
        _expect(batch.images.dtype == np.uint8, f"images are {batch.images.dtype}, uint8 is expected")
        _expect(batch.images.shape[1:3] == (batch.camera.height, batch.camera.width), "the camera has another size")
        _expect(len(batch.keys) == len(batch.stamps_ns) == len(batch), "keys, stamps and images differ in number")
    part = next(iter(sensor.frames(plan.at([int(order[-1])]))))
    _expect(np.array_equal(part.images[0], batches[-1].images[-1]), "the last frame looks otherwise when asked alone")
    _expect(part.keys[0] == batches[-1].keys[-1], "the last frame has another key when asked alone")


def check_sink(sink: Any, folder: Path) -> None:
    """Takes every record, with and without a tick; completes its files; a whole run needs no repair; pickles."""
    _common("sink", sink)
    sink.open(folder)
    for path, record, tick in sample_records():
        sink.write(path, record, tick)
        sink.flush()
    sink.close()
    _expect(sink.repair(folder) is None, "a run that ended well is said to need repair")
    pickle.loads(pickle.dumps(sink))  # noqa: S301  our own bytes


def check_study(study: Any, parts: api.Parts) -> None:
    """Names parts there are; the same seed gives the same metrics, bit for bit, and every metric has one name."""
    _common("study", study)
    known = {f.name for f in fields(api.Parts)}
    _expect(set(study.needs) <= known, f"needs {sorted(set(study.needs) - known)}, there is {sorted(known)}")
    first, second = (study.run(parts, Recorder(), np.random.default_rng(7)) for _ in range(2))
    names = [metric.name for metric in first.metrics]
    _expect(len(names) == len(set(names)) > 0, f"the metrics {names} are none or not unique")
    _expect(list(first.metrics) == list(second.metrics), "the same seed gives other metrics the second time")
    for name, table in first.tables.items():
        _expect(len({len(column) for column in table.values()}) <= 1, f"the columns of table '{name}' differ in length")


def sample_records() -> Iterator[tuple[str, api.Record, Tick | None]]:
    """One record of every kind, with made-up but sound content."""
    rng = np.random.default_rng(3)
    picture = rng.integers(0, 255, (16, 24, 3), dtype=np.uint8)
    position_m = rng.uniform(-1, 1, (9, 3))
    steps = np.arange(4)
    tick = Tick(3, 300_000_000)
    panel = api.Panel("image", "Camera", ("camera/image",))
    yield "", api.ViewLayout(((panel,),)), None
    yield "room", api.Mesh(position_m[:3], np.array([[0, 1, 2]]), picture[0, :3]), None
    yield "cloud", api.PointCloud(position_m, picture[0, :9]), tick
    yield "graph", api.Graph(position_m, np.array([[0, 1], [1, 2]])), tick
    yield "springs", api.Graph(position_m, np.array([[0, 1], [1, 2]]), picture[0, :2]), tick
    yield "places", api.PlaceMap(position_m, rng.uniform(-3, 3, 9)), None
    yield "camera/image", api.Image(picture, "png", encode(picture, "png")), tick
    yield "camera", api.Pose(planar_poses([[1.0, 2.0, 3.0]], np.pi / 2)[0]), tick
    yield "signature", api.Signature(rng.random((5, 7), dtype=np.float32)), tick
    yield "distances", api.DistanceField(position_m, rng.random(9, dtype=np.float32)), tick
    yield "estimate", api.Estimate(position_m[0], position_m[1], "wrong", 0.5, None), tick
    yield "answers", api.Answers(position_m, position_m[::-1], ["nearest"] * 8 + ["wrong"]), None
    yield "error", api.Series(rng.random(4), steps, steps * 100_000_000, "m"), None
    yield "log", api.Text("a line", "WARN"), tick
    yield "summary", api.Text("# Title", markdown=True), None
    yield "progress", api.Progress("places", 3, 9), None


def _common(kind: str, component: Any) -> None:
    """A dataclass with the Protocol's members, documented, that survives pickling."""
    cls = type(component)
    check_component(kind, cls.__name__.lower(), cls)
    manual = str(cls.__doc__)
    _expect(not manual.startswith(f"{cls.__name__}("), f"{cls.__name__} has no docstring, and that is its manual")
    _expect(pickle.loads(pickle.dumps(component)) == component, "does not survive pickling")  # noqa: S301  our own


def _pictures(view: str, color: bool) -> Bytes:
    """Six smooth random pictures."""
    shape = (6, SIDE, SIDE) if view == "mirror" else (6, *PANORAMA_SHAPE)
    rng = np.random.default_rng(11)
    layers = [np.clip(128 + 60 * _smooth(rng, shape), 0, 255).astype(np.uint8) for _ in range(3 if color else 1)]
    return np.stack(layers, axis=-1) if color else layers[0]


def _generators() -> list[np.random.Generator]:
    """One for each of the pictures."""
    return [np.random.default_rng(seed) for seed in range(6)]


def _smooth(rng: np.random.Generator, shape: tuple[int, int, int]) -> Floats:
    """Periodic noise (N, rows, columns) of unit variance whose spectrum falls off like 1 / frequency."""
    spectrum = np.fft.fft2(rng.standard_normal(shape))
    fy, fx = np.fft.fftfreq(shape[1])[:, None], np.fft.fftfreq(shape[2])[None, :]
    spectrum /= np.hypot(fy, fx) + 0.05
    noise = np.fft.ifft2(spectrum).real
    return np.asarray(noise / noise.std(axis=(1, 2), keepdims=True))


def _same(one: Signatures, other: Signatures, tolerance: float) -> bool:
    scale = float(np.abs(one.place).max()) or 1.0
    return one.place.shape == other.place.shape and bool(
        np.allclose(one.place, other.place, rtol=tolerance, atol=tolerance * scale)
    )


def _expect(good: bool, message: str) -> None:
    if not good:
        raise AssertionError(message)
