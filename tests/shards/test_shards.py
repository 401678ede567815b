"""A run in shards gives the bytes of the run as a whole, by any number of them; and what cannot be split says why."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.runner.build import build
from omnilab.runner.execute import execute
from omnilab.runner.overrides.composition import compose
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import load_run
from omnilab.runner.shards.part_file import FILE, About, joined, read_part, write_part
from omnilab.runner.shards.shard import Shard, shards_of, stages_of
from omnilab.runner.shards.work import JobPlace, OneShard
from omnilab.runner.sweeps import load_sweep

PLUGIN = Path(__file__).with_name("omnilab_shares.py")
SHARES = ("~experiment", "study=shares", "~sinks.rerun", "~sinks.mcap", "hydra/launcher=basic")
WORLD = Path(__file__).parents[1] / "box_world.yaml"
QUICKSTART = (
    "experiment=quickstart", "study.query_count=16", "study.show=2", f"sensor.world={WORLD}", "sensor.size=64",
    "sensor.samples=1", "sensor.batch=2", "descriptor.offsets=24", "descriptor.angles=36", "study.step_m=1.0",
    "+disturbance@disturbances.noise=uniform_noise", "cache=off", "~sinks.rerun", "~sinks.mcap", "~sinks.console",
)  # fmt: skip
MAP = (
    "experiment=map", f"sensor.world={WORLD}", "sensor.size=64", "sensor.samples=1", "sensor.batch=2", "study.step_m=1.0",
    "study.show=2", "cache=off", "~sinks.rerun", "~sinks.mcap", "~sinks.console",
)  # fmt: skip
VIEW_COUNT = (
    "experiment=view_count", "study.seeds=5", "study.counts=[2,4]", "study.drives.laps=1",
    "study.fewer_seeds={view_graph:3}", "~sinks.rerun", "~sinks.mcap", "~sinks.console",
)  # fmt: skip


@pytest.fixture
def shares(omnilab_here, monkeypatch):
    """`shares(*words)`: the study of omnilab_shares.py in tmp_path/s, in this process."""
    monkeypatch.setenv("OMNILAB_PLUGINS", str(PLUGIN))
    where = {True: "hydra.sweep.dir=s", False: "hydra.run.dir=w"}
    return lambda *words: omnilab_here(*SHARES, where[any("shards=" in word for word in words)], *words)


@pytest.fixture
def resumed(omnilab_here, monkeypatch):
    monkeypatch.setenv("OMNILAB_PLUGINS", str(PLUGIN))
    return lambda *options: omnilab_here("sweep", "resume", "s", *options)


def jobs() -> dict[str, Path]:
    """The folders of the sweep's jobs, by shard."""
    return {job.settings["shard"]: job.folder for job in load_sweep("s").jobs}


class Beside(OneShard):
    """A shard whose siblings are folders beside its own, named by their shards: no sweep is needed."""

    def _folder_of(self, shard: Shard) -> Path:
        return self.place.folder.parent / str(shard)


def check_same(folder: Path, words: tuple[str, ...], numbers: tuple[int, ...], tables: tuple[str, ...]) -> None:
    registry = discover()
    config = compose(words, registry).config
    config.logs = str(folder / "logs")
    whole = build(config, registry)
    execute(whole, folder / "w", registry)
    for n in numbers:
        for shard in shards_of(stages_of(whole.study), n):
            config.shard = str(shard)
            place = JobPlace(folder, folder / f"s{n}" / str(shard), ())
            execute(build(config, registry), place.folder, registry, shards=Beside(shard, place, "0"))
        for name in ("metrics", *tables):
            assert (place.folder / f"{name}.csv").read_bytes() == (folder / f"w/{name}.csv").read_bytes(), (n, name)
        for figure in (folder / "w").glob("*.png"):
            if figure.stem != "counts":  # which shows measured times
                assert (place.folder / figure.name).read_bytes() == figure.read_bytes(), (n, figure.name)
        assert load_run(place.folder).manifest["identity"] == load_run(folder / "w").manifest["identity"]


def test_two_stages_in_shards_are_the_run_as_a_whole(shares):
    assert shares().rc == 0
    result = shares("shards=2")
    assert result.rc == 0, result.stderr
    folders = jobs()
    assert [*folders] == [*(f"{stage}-{k}-of-2" for stage in ("draws", "distances") for k in (1, 2)), "all-2-of-2"]
    for name in ("metrics.csv", "distances.csv"):
        assert (folders["all-2-of-2"] / name).read_bytes() == Path("w", name).read_bytes()
    assert "shard" not in (folders["all-2-of-2"] / "config.yaml").read_text(), "it is repeated as the whole"


@pytest.mark.slow
def test_localisation_in_any_number_of_shards(tmp_path):
    check_same(tmp_path, QUICKSTART, (1, 3, 7), ("queries",))


@pytest.mark.slow
@pytest.mark.parametrize("descriptor", ["radon", "rotational_pca"])
def test_a_map_in_any_number_of_shards(descriptor, tmp_path):
    """With what a descriptor has learnt: the file that other runs localise in."""
    check_same(tmp_path, (*MAP, f"descriptor={descriptor}"), (2, 5), ())
    for n in (2, 5):
        merged = tmp_path / f"s{n}" / f"all-{n}-of-{n}" / "map.npz"
        assert merged.read_bytes() == (tmp_path / "w" / "map.npz").read_bytes()


@pytest.mark.slow
def test_drives_in_any_number_of_shards(tmp_path):
    check_same(tmp_path, VIEW_COUNT, (2, 7), ("drives", "counts"))


@pytest.mark.slow
def test_what_failed_is_named_and_run_again_alone(shares, resumed, omnilab_here):
    result = shares("shards=2", "study.fail_at=7")
    assert result.rc == 1
    assert "shard distances-2-of-2 is failed; go on with the sweep: omnilab sweep resume" in result.stderr
    assert "--retry-failed" in result.stderr
    Path("mended").touch()
    before = {shard: (folder / FILE).stat().st_mtime_ns for shard, folder in jobs().items() if (folder / FILE).exists()}
    assert len(before) == 3
    result = resumed("--retry-failed")
    assert result.rc == 0, result.stderr
    assert shares("study.fail_at=7").rc == 0
    folders = jobs()
    assert (folders["all-2-of-2"] / "metrics.csv").read_bytes() == Path("w/metrics.csv").read_bytes()
    assert before.items() <= {s: (f / FILE).stat().st_mtime_ns for s, f in folders.items() if "all" not in s}.items()
    result = omnilab_here("repeat", str(folders["draws-1-of-2"]))
    assert result.rc == 2
    assert "the run is shard draws-1-of-2 of a sweep" in result.stderr


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ({"run": "0" * 64}, "holds shard draws-1-of-2 of a run with other settings, seed, versions or files"),
        ({"commit": "0" * 40}, "holds shard draws-1-of-2 of commit 0000000000, and this is none, an installed omnilab"),
        ({"last": 3}, "holds shard draws-1-of-2 of units 0 to 3 of 10, not 0 to 4 of 10"),
        (b"PK", "cannot be read (it is no whole archive of arrays)"),
        (None, "cannot be read (No such file or directory)"),
    ],
)
def test_shards_that_do_not_belong_together_are_not_merged(how, sentence, tmp_path):
    wanted = About("draws-1-of-2", 0, 4, 10, "1" * 64, None)
    if isinstance(how, dict):
        write_part(tmp_path, replace(wanted, **how), {"draw": np.arange(4)})
    elif how is not None:
        (tmp_path / FILE).write_bytes(how)
    with pytest.raises(DataError) as refused:
        read_part(tmp_path, wanted)
    assert sentence in str(refused.value)
    write_part(tmp_path, wanted, {"draw": np.arange(4)})
    assert read_part(tmp_path, wanted)["draw"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["shards=0"], "shards=0 is no number of shards; give one whole number from 1"),
        (["shards=2", "shards=3"], "shards=2 shards=3 is no number of shards"),
        (["shards=2", "seed=1,2"], "shards=2 splits one run, and the command varies seed"),
        (["shards=2", "objective=last"], "shards=2 and objective=last do not go together"),
        (["shards=2", "study=pose_graph"], "shards=2: the work of this study cannot be split; that of grid, map, shares, view_count can"),
        (["shard=draws-1-of-2"], "shard=draws-1-of-2 is a job of a sweep, which needs the others; give shards=2 in its place"),
        (["shard=draws-3-of-2"], "shard=draws-3-of-2 is none of this study's"),
        (["shard=places-1-of-2"], "shard=places-1-of-2 is none of this study's"),
    ],
)  # fmt: skip
def test_what_cannot_be_split_says_why(words, sentence, shares):
    result = shares(*words)
    assert result.rc == 2
    assert sentence in result.stderr
    assert not Path("s").exists()


@settings(max_examples=50)
@given(count=st.integers(1, 3000), at_once=st.integers(1, 100), of=st.integers(1, 40))
def test_shares_are_even_groups_and_all_of_the_work(count, at_once, of):
    groups = -(-count // at_once)
    if of > groups:
        with pytest.raises(ConfigError, match=f"give shards={groups} or fewer"):
            Shard("places", 1, of).share(count, at_once)
        return
    shares = [Shard("places", k, of).share(count, at_once) for k in range(1, of + 1)]
    assert [first for first, _ in shares] == [0, *(last for _, last in shares[:-1])]
    assert shares[-1][1] == count
    assert all(first % at_once == 0 for first, _ in shares)
    sizes = [-(-(last - first) // at_once) for first, last in shares]
    assert max(sizes) - min(sizes) <= 1


@settings(max_examples=30)
@given(rows=st.lists(st.integers(0, 2), min_size=1, max_size=12), cuts=st.lists(st.integers(0, 12), max_size=4))
def test_what_is_degenerate_is_so_however_it_was_cut(rows, cuts):
    """Queries of three signatures, cut anywhere, some cuts joined as in a shard: the warnings of all of them together."""
    from omnilab.api import Places
    from omnilab_studies.common.scores import Degeneracy

    class Scored:
        place, decided = None, None

    def warned(parts: list[list[int]]) -> list[str]:
        degeneracy = Degeneracy(Places(Signatures(np.eye(4, 3, dtype=np.float32) + 1), None, list("abcd")))
        seen = []
        for part in parts:
            scored = Scored()
            scored.place, scored.decided = np.array(part, int), np.array(part, int) > 0
            seen.append(degeneracy.look_at(Signatures(np.eye(3, dtype=np.float32)[part] + 1), scored))
        for half in (seen[::2], seen[1::2]):
            degeneracy.count(joined(half))
        return degeneracy.query_warnings()

    edges = sorted({0, len(rows), *(min(cut, len(rows)) for cut in cuts)})
    assert warned([rows[a:b] for a, b in pairwise(edges)]) == warned([rows])
