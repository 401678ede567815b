"""Local maps by springs and by stress majorisation beside scikit-learn.

pytest tests/benchmarks/test_bench_local_maps.py --benchmark-enable -n 0

`stress` of each row is normalised: within 1 % of the least of its group, rows have done the same work.
"""

import warnings

import numpy as np
import pytest
from sklearn.manifold import MDS

from omnilab.api import Places, Signatures
from omnilab.geometry import planar_poses
from omnilab_appearance import Euclidean, Smacof, Spring
from omnilab_appearance.localizers.local_maps import Constants, stress
from omnilab_appearance.localizers.spring import Integrator

HALL = (22, 11)  # images of the paper's hall, 0.1 m apart
SETS = 50
MAKERS = {
    "smacof": Smacof(),
    "smacof, 1 %": Smacof(tolerance=1e-3),
    "smacof, inverse_square": Smacof(constants=Constants.inverse_square),
    "spring": Spring(),
    "spring, 1 %": Spring(tolerance=3e-3),
    "spring, inverse_square": Spring(constants=Constants.inverse_square),
    "spring, euler": Spring(integrator=Integrator.euler),
}
THEIRS = {"random start": {"init": "random"}, "4 random starts": {"init": "random", "n_init": 4}}
THEIRS["classical start"] = {"init": "classical_mds"}


def unlike(points, noise, seed):
    """Distances (B, n, n) that saturate as images' do, each pair spoilt by its own factor."""
    apart = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)
    factor = np.triu(np.random.default_rng(seed).normal(0, noise, apart.shape), 1)
    return apart / (1 + apart) * np.exp(factor + factor.swapaxes(1, 2))


@pytest.fixture(scope="module")
def local():
    """Nine places and a query, 50 times."""
    return unlike(np.random.default_rng(0).uniform(0, 0.6, (SETS, 10, 2)), 0.1, 1)


@pytest.fixture(scope="module")
def hall():
    x, y = np.meshgrid(0.1 * np.arange(HALL[0]), 0.1 * np.arange(HALL[1]))
    return unlike(np.stack([x.ravel(), y.ravel()], axis=1)[None], 0.05, 2)


def ours(benchmark, maker, given):
    made = benchmark.pedantic(maker.embed, (given, np.random.default_rng(0)), rounds=3, warmup_rounds=1)
    benchmark.extra_info.update(
        count=len(given), unit="a map", stress=float(made.stress.mean()), iterations=float(made.iterations.mean())
    )


def theirs(benchmark, name, given):
    settings = THEIRS[name]
    benchmark.extra_info["peer"] = f"`sklearn.manifold.MDS`, {name}"

    def fit():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.stack([MDS(metric="precomputed", random_state=0, **settings).fit_transform(d) for d in given])

    made = benchmark.pedantic(fit, rounds=2)
    counts = np.broadcast_to(~np.eye(given.shape[1], dtype=bool), given.shape)
    found = float(stress(made, given, counts).mean())
    benchmark.extra_info.update(count=len(given), unit="a map", stress=found)


@pytest.mark.benchmark(group=f"{SETS} local maps of 10 images")
@pytest.mark.parametrize("name", MAKERS)
def test_local_maps(benchmark, local, name):
    ours(benchmark, MAKERS[name], local)


@pytest.mark.benchmark(group=f"{SETS} local maps of 10 images")
@pytest.mark.parametrize("name", THEIRS)
def test_local_maps_scikit_learn(benchmark, local, name):
    theirs(benchmark, name, local)


@pytest.mark.benchmark(group="a map of 22 x 11 images")
@pytest.mark.parametrize("name", MAKERS)
def test_hall(benchmark, hall, name):
    ours(benchmark, MAKERS[name], hall)


@pytest.mark.benchmark(group="a map of 22 x 11 images")
@pytest.mark.parametrize("name", THEIRS)
def test_hall_scikit_learn(benchmark, hall, name):
    theirs(benchmark, name, hall)


@pytest.mark.benchmark(group=f"{SETS} queries located among 1271 places, 9 neighbours")
@pytest.mark.parametrize("name", ["smacof", "spring"])
def test_locate(benchmark, name):
    x, y = np.meshgrid(np.arange(-4, 4.01, 0.2), np.arange(-3, 3.01, 0.2))
    position_m = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    features = np.random.default_rng(0).standard_normal((3, 512))
    seen = Signatures(np.float32(np.tanh(position_m @ features)))
    index = MAKERS[name].prepare(Places(seen, planar_poses(position_m), [""] * x.size), Euclidean())
    queries = np.random.default_rng(1).uniform([-3, -2, 1], [3, 2, 1], (SETS, 3))
    found = benchmark.pedantic(
        MAKERS[name].locate, (Signatures(np.float32(np.tanh(queries @ features))), index), rounds=5, warmup_rounds=1
    )
    error_m = np.linalg.norm(found.position_m - queries, axis=1)
    why = "no library places a query in a local map; the maps themselves are above"
    benchmark.extra_info.update(count=SETS, unit="a query", no_peer=why, median_error_m=float(np.median(error_m)))
