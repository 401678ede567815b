"""Numbers out of the range that a setting declares: one sentence with name, value and range, wherever they come from."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from pathlib import Path
from types import NoneType
from typing import Any, get_type_hints

import numpy as np
import pytest
from omegaconf import OmegaConf

from omnilab.api import KINDS, RandomPoses, check_settings, setting
from omnilab.api.settings import LARGEST, LARGEST_COUNT, Range, out_of_range, plain_types, ranges_of
from omnilab.errors import ConfigError, DataError
from omnilab.runner.build import build
from omnilab.runner.config import Run, Settings
from omnilab.runner.manual import settings_data, settings_of
from omnilab.runner.registry import discover
from omnilab_appearance import Radon
from omnilab_mirror import Mirror
from omnilab_studies import MapStudy, Render

WORLD = str(Path(__file__).parents[1] / "box_world.yaml")
NAN, INF = math.nan, math.inf


@dataclass
class Inner:
    """Settings within settings."""

    count: int = setting(3, at_least=2)


@dataclass
class Example:
    """One setting of each sort."""

    above: float = setting(1.0, above=0)
    share: float | None = setting(None, at_least=0, below=1)
    count: int = setting(9, at_least=3)
    even: int = setting(8, at_least=2, at_most=100, multiple_of=2)
    seventh: int = setting(7, multiple_of=7)
    pair: list[float] = setting([1.0, 2.0], above=0, count=2)  # both
    some: list[int] = setting([1], at_least=1, fewest=1)
    sizes: list[list[int]] = setting([[1, 2]], at_least=1)
    by_name: dict[str, int] = setting({}, at_least=2)
    endless: float = setting(1.0, above=0, finite=False)
    plain: float = 0.0
    anything: dict[str, Any] = field(default_factory=dict)
    inner: Inner = field(default_factory=Inner)
    flag: bool = True

    def __post_init__(self) -> None:
        check_settings(self)


WRONG = [
    ({"above": NAN}, "above=nan is not a number; give a number above 0"),
    ({"above": -0.0}, "above=-0 is out of range; give a number above 0"),
    ({"above": INF}, "above=inf is not finite; give a number above 0"),
    ({"above": 1e300}, "above=1e+300 is out of range; give a number above 0 and up to 1e+12"),
    ({"above": 10**400}, "above=(a number of 1329 bits) is out of range; give a number above 0 and up to 1e+12"),
    ({"above": np.float32("nan")}, "above=nan is not a number; give a number above 0"),
    ({"share": 1.0}, "share=1 is out of range; give a number of 0 or more and below 1, or null"),
    ({"count": 2}, "count=2 is out of range; give a whole number of 3 or more"),
    ({"count": 2**31}, "count=2147483648 is out of range; give a whole number from 3 to 2147483647"),
    ({"count": 4.5}, "count=4.5 is not whole; give a whole number of 3 or more"),
    ({"count": NAN}, "count=nan is not a number; give a whole number of 3 or more"),
    ({"even": 7}, "even=7 is out of range; give an even number from 2 to 100"),
    ({"seventh": 8}, "seventh=8 is out of range; give a whole number, a multiple of 7"),
    ({"pair": [1.0]}, "pair=[1.0] holds 1 number; give 2 numbers above 0"),
    ({"pair": [1.0, -INF]}, "pair=[1.0, -inf] holds -inf, which is not finite; give 2 numbers above 0"),
    ({"some": []}, "some=[] holds 0 numbers; give 1 or more whole numbers of 1 or more"),
    ({"sizes": [[1, 0]]}, "sizes=[[1, 0]] holds 0, which is out of range; give whole numbers of 1 or more"),
    ({"by_name": {"slow": 1}}, "by_name={'slow': 1} holds 1, which is out of range; give whole numbers of 2 or more"),
    ({"endless": NAN}, "endless=nan is not a number; give a number above 0"),
    ({"plain": INF}, "plain=inf is not finite; give a finite number"),
    ({"anything": {"a": {"b": [1, NAN]}}}, "anything={'a': {'b': [1, nan]}} holds nan, which is not a number; give finite numbers"),
    ({"inner": Inner(1)}, "inner.count=1 is out of range; give a whole number of 2 or more"),
]  # fmt: skip


@pytest.mark.parametrize(("values", "sentence"), WRONG, ids=[next(iter(values)) for values, _ in WRONG])
def test_a_value_out_of_range_is_one_sentence(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError) as error:
        Example(**values)
    assert str(error.value) == sentence


@pytest.mark.parametrize("values", [
    {}, {"above": 1e-300}, {"above": 3}, {"above": np.float32(2)}, {"share": 0}, {"share": None}, {"count": np.int64(3)},
    {"even": 100}, {"pair": [3, 4]}, {"sizes": []}, {"endless": INF}, {"plain": -1e300}, {"anything": {"a": "nan", "b": True}},
    {"above": LARGEST}, {"count": LARGEST_COUNT},
])  # fmt: skip
def test_a_value_within_its_range_is_taken(values: dict[str, Any]) -> None:
    Example(**values)


@pytest.mark.parametrize(("limits", "words"), [
    (Range(above=0, at_most=1), "above 0 and up to 1"), (Range(at_least=1e-6), "1e-06 or more"),
    (Range(above=-90, below=90), "above -90 and below 90"), (Range(at_most=5), "up to 5"), (Range(), ""),
])  # fmt: skip
def test_a_range_is_said_in_words(limits: Range, words: str) -> None:
    assert limits.interval == words


# ------------------------------------------------------------------------------------------------------ all components
def numeric() -> list[tuple[str, type[Any], str, Range]]:
    """Kind and name of every component of ours, its class, and a setting of it that is one number, with its range."""
    classes = {f"{c.kind}={c.name}": c.cls for c in discover("").components.values()} | {"run": Settings}
    return [
        (where, cls, name, allowed)
        for where, cls in classes.items()
        for name, allowed in ranges_of(cls).items()
        if not allowed.listed
        and isinstance(getattr(cls, name, None), int | float)
        and getattr(cls, name) not in {True, False}
    ]


def refuses(cls: type[Any], name: str, value: float, allowed: Range) -> bool:
    """Whether a class refuses a value of a setting in a sentence that names both and the range."""
    try:
        cls(**{name: value})
    except ConfigError as error:
        return f"{name}={value}" in str(error) and allowed.allowed in str(error)
    return False


def test_every_float_of_every_component_refuses_nan_and_infinity_where_it_is_made() -> None:
    found = numeric()
    assert len(found) > 250
    made = [each for each in found if each[0] != "run" and all(f.default != "???" for f in fields(each[1]))]
    let_through = [
        f"{where}.{name}={value}"
        for where, cls, name, allowed in made
        for value in (NAN, INF, -INF)
        if not refuses(cls, name, value, allowed)
    ]
    assert let_through == []


def test_whole_numbers_of_components_have_a_limit_below_which_libraries_count() -> None:
    seeds = {"seed"}
    unlimited = [f"{where}.{name}" for where, _, name, allowed in numeric()
                 if allowed.whole and name not in seeds and not allowed.limits[1] <= LARGEST_COUNT]  # fmt: skip
    assert unlimited == []
    undeclared = [f"{where}.{name}" for where, cls, name, allowed in numeric()
                  if isinstance(getattr(cls, name), int) and not allowed.whole]  # fmt: skip
    assert undeclared == [], "declare the range of a count: setting(DEFAULT, at_least=...)"


def with_inner(where: str, cls: type[Any]) -> Iterator[tuple[str, type[Any]]]:
    """A class of settings, and those of its settings that have settings of their own."""
    yield where, cls
    for name, hint in get_type_hints(cls).items():
        if name in {f.name for f in fields(cls)} and is_dataclass(hint):
            yield from with_inner(f"{where}.{name}", hint)


def test_every_setting_that_may_be_a_number_declares_its_range_and_its_default_is_within() -> None:
    numbers, others = {int, float, Any}, {str, bool, NoneType}
    names = ["run.objective"]  # a name or a list of names, which OmegaConf knows no type for
    roots = {f"{c.kind}={c.name}": c.cls for c in discover("").components.values()} | {"run": Settings}
    classes = [found for root in roots.items() for found in with_inner(*root)]
    assert len(classes) > len(roots)
    undeclared, outside = [], []
    for where, cls in classes:
        hints, defaults = get_type_hints(cls), {f.name: f.default for f in fields(cls)}
        kinds = {f.name: set(plain_types(hints[f.name])) for f in fields(cls)}
        undeclared += [
            f"{where}.{f.name}" for f in fields(cls) if kinds[f.name] & numbers and "range" not in f.metadata
        ]
        outside += [wrong for wrong in [out_of_range(cls, defaults, f"{where}.")] if wrong]
        assert all(
            kind & numbers or kind <= others or all(map(is_enum_or_class, kind - others)) for kind in kinds.values()
        )
    assert undeclared == names, "declare what it may be: setting(DEFAULT, above=0, at_most=...)"
    assert outside == []


def is_enum_or_class(kind: Any) -> bool:
    return isinstance(kind, type) and (issubclass(kind, Enum) or is_dataclass(kind))


# ------------------------------------------------------------------------------------------------- the command line
SMALL = ["experiment=quickstart", f"sensor.world={WORLD}", "sensor.size=32", "sensor.samples=1", "sinks=null"]


@pytest.mark.parametrize(("override", "told"), [
    *((f"study.heading_step_deg={v}", f"study.heading_step_deg={v}") for v in ("-8", "250", "400", "0", "inf", "nan")),
    ("study.heading_step_deg=1e-300", "from 1e-06 to 180, or null"),
    ("study.heading_step_deg=1e9", "study.heading_step_deg=1e+09 is out of range"),
    ("study.extent_m=[inf,1]", "study.extent_m=[inf, 1.0] holds inf, which is not finite; give 2 numbers above 0, or null"),
    ("threads=1000000", "threads=1000000 is out of range; give a whole number from 1 to 256"),
    ("sensor.a_mm=nan", "sensor.a_mm=nan is not a number; give a number above 0"),
    ("sensor.size=2147483648", "sensor.size=2147483648 is out of range"),
    ("study.query_count=2147483648", "give a whole number from 1 to 1000000"),
    ("study.step_m=0.00001", "give a larger step_m or a smaller extent_m"),
    ("+sensor@sensors=mirror", "sensors holds components by name; give each one, as in +sensor@sensors.NAME=..."),
    ("seed=-1", "seed=-1 is out of range; give a whole number from 0 to 9223372036854775807"),
    ("cache_gb=nan", "cache_gb=nan is not a number; give a number above 0"),
    ("distance.angle_band=nan", "distance.angle_band=nan is not a number"),
    ("+disturbance@disturbances.dark=light disturbances.dark.gain=nan", "disturbances.dark.gain=nan is not a number"),
])  # fmt: skip
def test_a_run_refuses_it_by_the_path_of_the_setting(omnilab_here, override: str, told: str) -> None:
    distance = ["distance=poc_band"] if override.startswith("distance.") else []
    result = omnilab_here(*SMALL[:-1], *distance, *override.split())
    assert result.rc == 2
    assert told in result.stderr.strip()
    assert len(result.stderr.strip().splitlines()) == 1


def test_components_of_others_need_only_finite_numbers(omnilab_here, tmp_path, monkeypatch) -> None:
    (tmp_path / "other.py").write_text(
        "from dataclasses import dataclass\nfrom typing import ClassVar\nimport numpy as np\n"
        "from omnilab.api import Signatures\nfrom omnilab.hooks import hookimpl\n"
        "@dataclass\nclass Other:\n    '''A.'''\n    factor: float = 1.0\n    view: ClassVar[str] = 'mirror'\n"
        "    color: ClassVar[bool] = False\n    rotation: ClassVar[str] = 'none'\n    default_distance: ClassVar[str] = 'cosine'\n"
        "    def describe(self, images): return Signatures(np.ones((len(images), 3), np.float32))\n"
        "@hookimpl\ndef register_descriptors(register): register('other', Other)\n"
    )
    monkeypatch.setenv("OMNILAB_PLUGINS", "other.py")
    result = omnilab_here(*SMALL[:-1], "descriptor=other", "descriptor.factor=nan")
    assert (result.rc, result.stderr) == (2, "omnilab: descriptor.factor=nan is not a number; give a finite number\n")


@pytest.mark.parametrize(("slot", "setting_name", "value", "told"), [
    ("sensor", "world", "a\0b", "holds the character NUL"), ("study", "path", "a\0b", "holds the character NUL"),
    ("sensors.other", "variant", "a\0b", "holds the character NUL"), ("sensor", "up", "y" * 5000, "holds a text of 5000 characters"),
])  # fmt: skip
def test_a_text_that_is_no_name_and_no_path_is_refused(slot: str, setting_name: str, value: str, told: str) -> None:
    config = OmegaConf.structured(Run)
    config.study = OmegaConf.structured(MapStudy)
    config.sensor, config.sensors = OmegaConf.structured(Mirror), {"other": OmegaConf.structured(Mirror)}
    OmegaConf.update(config, f"{slot}.{setting_name}", value)
    with pytest.raises(ConfigError, match=f"{slot}.{setting_name} {told}"):
        build(config, discover(""))


def test_the_manual_shows_ranges(omnilab_here) -> None:
    assert "offsets: int = 173  # samples across the image circle; from 4 to 4096" in settings_of(Radon)
    assert settings_of(Example)[5] == "pair: list[float] = [1.0, 2.0]  # both; above 0"
    out = omnilab_here("plugins", "grid").stdout
    assert "from 1e-06 to 180" in out
    assert "setting(" not in out


def test_settings_are_data_for_a_form(omnilab_here) -> None:
    """Of every component and of the run: name, type, unit, default, comment, range."""
    found = json.loads(omnilab_here("plugins", "--json").stdout)
    registry = discover("")
    assert [(c["kind"], c["name"]) for c in found[1:] if c["kind"] in KINDS] == [
        (c.kind, c.name) for c in registry.components.values()
    ]
    run = {s["name"]: s for s in found[0]["settings"]}
    assert run["limits"]["default"] is True
    radon, grid = json.loads(omnilab_here("plugins", "radon", "grid", "--json").stdout)
    offsets = next(s for s in radon["settings"] if s["name"] == "offsets")
    assert offsets["comment"] == "samples across the image circle"
    assert (offsets["type"], offsets["default"], offsets["unit"], offsets["required"]) == ("int", 173, None, False)
    assert (offsets["range"]["lowest"], offsets["range"]["highest"], offsets["range"]["whole"]) == (4, 4096, True)
    step = next(s for s in grid["settings"] if s["name"] == "step_m")
    assert step["unit"] == "m"
    assert (step["range"]["lowest"], step["range"]["above"], step["range"]["highest"]) == (None, 0, LARGEST)
    assert step["range"]["allowed"] == "a number above 0, or null"
    assert next(s for s in grid["settings"] if s["name"] == "queries")["choices"] == ["random", "rest"]


def test_settings_within_settings_and_those_without_a_default_are_data_too() -> None:
    found = {s["name"]: s for s in settings_data(Example)}
    assert found["endless"]["range"]["highest"] is None
    assert found["inner"]["settings"][0]["range"]["allowed"] == "a whole number of 2 or more"
    assert (found["inner"]["default"], found["flag"]["range"]) == ({"count": 3}, None)
    folder = next(s for s in settings_data(Render) if s["name"] == "folder")
    assert (folder["required"], folder["default"], folder["range"], folder["writes"]) == (True, None, None, True)


# ------------------------------------------------------------------------------------------------ work that is too large
@pytest.mark.slow
def test_work_beyond_the_memory_that_is_free_is_done_where_it_is_asked_for_and_a_file_asks_for_nothing(
    omnilab_here, monkeypatch
) -> None:
    tiny = [*SMALL[:-1], "descriptor=tiny_image", "study.step_m=1.5", "study.query_count=4", "cache=off"]
    monkeypatch.setattr("omnilab.limits.free_memory", lambda: 1000.0)
    refused = omnilab_here(*tiny)
    assert refused.rc == 2
    assert refused.stderr.strip().endswith("MB are free; give a larger step_m or a smaller extent_m, or limits=off to try it all the same")  # fmt: skip
    assert omnilab_here(*tiny, "limits=off").rc == 0
    run = str(Path("logs/latest").resolve())
    repeated = omnilab_here("repeat", "limits=off")
    assert omnilab_here("repeat", run).rc == 2
    assert (repeated.rc, repeated.stderr.strip()[-11:]) == (0, "bit for bit")


@pytest.mark.slow
def test_images_that_do_not_fit_onto_the_disk_are_refused_after_the_first_ones(omnilab_here, monkeypatch) -> None:
    render = [
        "experiment=render",
        *SMALL[1:-1],
        "study.folder=set",
        "study.layout=random",
        "study.count=130",
        "cache=off",
    ]
    monkeypatch.setattr("omnilab.limits.free_disk", lambda _: 5000.0)
    refused = omnilab_here(*render)
    assert refused.rc == 2
    assert "66 images take at least" in refused.stderr
    assert "0.005 MB are free in set; give fewer, or a folder with more room, or limits=off" in refused.stderr
    assert omnilab_here(*render, "limits=off").rc == 0  # and goes on with it


def test_images_that_do_not_fit_into_memory_are_refused_before_the_work() -> None:
    with pytest.raises(ConfigError, match=r"batch=4096 images of 8192 x 8192 pixels .*; give batch=32 or less"):
        Mirror(world=WORLD, size=8192, batch=4096)
    assert Mirror(world=WORLD, size=8192, batch=32).batch == 32  # the advice works


@pytest.mark.parametrize("step", [-0.1, 4.0, 0.0, NAN, INF])
def test_random_poses_of_a_script_need_a_step_of_headings_that_makes_headings(step: float) -> None:
    sensor = Mirror(world=WORLD, size=32)
    with pytest.raises(DataError, match="give a step above 0 and up to 180 degrees"):
        sensor.plan(RandomPoses(5, 0, step))
    headings = sensor.plan(RandomPoses(200, 0, np.pi / 2)).T_world_camera
    assert headings is not None
    assert len(np.unique(np.round(headings[:, 0, 0], 6))) == 3  # 0, 90, 180, 270 degrees: cosines 1, 0, -1


def test_settings_changed_in_a_study_are_checked_too() -> None:
    with pytest.raises(ConfigError, match="height_m=nan is not a number"):
        replace(Mirror(world=WORLD), height_m=NAN)
