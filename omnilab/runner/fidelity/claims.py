"""The claims: what a publication reports, and the runs and metrics that test it. Data: `conf/claims/*.yaml`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

from omnilab.errors import ConfigError, DataError, did_you_mean
from omnilab.runner.fidelity.quantities import Quantity, parsed_quantity
from omnilab.runner.fidelity.verdicts import Expectation
from omnilab.runner.run_folder.reading import safe_yaml

CHAPTER_KEYS = {"title", "source", "runs", "claims"}
CLAIM_KEYS = {"id", "place", "says", "reported", "expect", "protocol", "variant", "not_reproduced", "note"}


@dataclass(frozen=True)
class ClaimRun:
    """A run that claims are measured in: a recipe with overrides. Every seed of it is one run folder."""

    name: str
    recipe: str
    overrides: tuple[str, ...] = ()
    minutes: float = 1.0  # about, on one core: cheap ones are run first

    @property
    def words(self) -> list[str]:
        """As on the command line."""
        return [f"experiment={self.recipe}", *self.overrides]


@dataclass(frozen=True)
class Measurement:
    """Named quantities: one that is held against a number, or several whose order counts."""

    quantities: Mapping[str, Quantity]

    @property
    def runs(self) -> list[str]:
        return list(dict.fromkeys(run for quantity in self.quantities.values() for run in quantity.runs))


@dataclass(frozen=True)
class Claim:
    """One claim. Without a protocol it cannot be tested, and says why."""

    id: str
    place: str  # section, figure, table, equation
    says: str
    reported: str  # the publication's figure, as a text
    expect: Expectation | None
    protocol: Measurement | None  # as the publication measured
    variant: Measurement | None  # a better method, or a harder protocol, by the same expectation
    not_reproduced: str = ""  # why it cannot be tested
    note: str = ""  # in what the protocol differs from the publication's

    @property
    def runs(self) -> list[str]:
        """The names of the runs that it needs."""
        measurements = filter(None, (self.protocol, self.variant))
        return list(dict.fromkeys(name for each in measurements for name in each.runs))

    @property
    def is_time(self) -> bool:
        """Whether it is about times, which other work on the machine changes."""
        measurements = filter(None, (self.protocol, self.variant))
        return any(quantity.is_time for each in measurements for quantity in each.quantities.values())


@dataclass(frozen=True)
class ClaimChapter:
    """The claims of one chapter or paper."""

    name: str
    title: str
    source: str
    claims: tuple[Claim, ...]


@dataclass(frozen=True)
class ClaimSet:
    """All chapters, and the runs that their claims share."""

    chapters: tuple[ClaimChapter, ...]
    runs: Mapping[str, ClaimRun] = field(default_factory=dict)

    @property
    def claims(self) -> list[Claim]:
        return [claim for chapter in self.chapters for claim in chapter.claims]

    def selected(self, pattern: str) -> ClaimSet:
        """The claims whose id, or chapter, is or matches a pattern (`altitude*`); ConfigError if there are none."""
        chapters = []
        for chapter in self.chapters:
            whole = fnmatchcase(chapter.name, pattern)
            claims = tuple(claim for claim in chapter.claims if whole or fnmatchcase(claim.id, pattern))
            chapters += [ClaimChapter(chapter.name, chapter.title, chapter.source, claims)] if claims else []
        if not chapters:
            known = [*(chapter.name for chapter in self.chapters), *(claim.id for claim in self.claims)]
            names = ", ".join(chapter.name for chapter in self.chapters)
            raise ConfigError(
                f"there is no claim '{pattern}'{did_you_mean(pattern, known)}; give the id of one, a pattern such as"
                f" 'altitude*', or a chapter: {names}"
            )
        return ClaimSet(tuple(chapters), self.runs)

    def quantities(self) -> dict[str, list[Quantity]]:
        """What all claims need of each run, by its name."""
        found: dict[str, dict[str, Quantity]] = {}
        for claim in self.claims:
            for measurement in filter(None, (claim.protocol, claim.variant)):
                for quantity in measurement.quantities.values():
                    found.setdefault(quantity.term.run, {})[quantity.text] = quantity
        return {name: list(quantities.values()) for name, quantities in found.items()}

    def needed(self) -> list[ClaimRun]:
        """The runs that these claims need, cheapest first."""
        names = dict.fromkeys(name for claim in self.claims for name in claim.runs)
        return sorted((self.runs[name] for name in names), key=lambda run: (run.minutes, run.name))


def shipped_claims() -> ClaimSet:
    """The claims that ship with omnilab."""
    folder = files("omnilab.conf") / "claims"
    return read_claims(sorted((f for f in folder.iterdir() if f.name.endswith(".yaml")), key=lambda f: f.name))


def read_claims(sources: Iterable[Traversable]) -> ClaimSet:
    """The claims of some files; DataError for a file that is not as it should be."""
    chapters: list[ClaimChapter] = []
    runs: dict[str, ClaimRun] = {}
    for source in sources:
        try:
            content = _mapping(safe_yaml(source.read_text(encoding="utf-8")), CHAPTER_KEYS, "the file")
            for name, run in content.get("runs", {}).items():
                if name in runs:
                    raise ValueError(f"the run '{name}' is in another file, too")
                runs[name] = _run(name, run)
            claims = tuple(map(_claim, content["claims"]))
            name = source.name.removesuffix(".yaml")
            chapters.append(ClaimChapter(name, content["title"], content["source"], claims))
        except Exception as error:  # also those of the YAML library
            why = f"it lacks {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
            raise DataError(f"{source} is no file of claims ({why}); correct it") from error
    found = ClaimSet(tuple(chapters), runs)
    _check(found)
    return found


def _check(found: ClaimSet) -> None:
    """DataError for an id that is there twice, or a run that is not there."""
    ids: set[str] = set()
    for claim in found.claims:
        if claim.id in ids:
            raise DataError(f"two claims have the id '{claim.id}'; give one of them another")
        ids.add(claim.id)
        for name in claim.runs:
            if name not in found.runs:
                raise DataError(
                    f"the claim '{claim.id}' is measured in the run '{name}', which no file has"
                    f"{did_you_mean(name, found.runs)}; add it to `runs`"
                )


def _mapping(content: Any, known: set[str], what: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise TypeError(f"{what} should be a mapping")
    if unknown := content.keys() - known:
        raise ValueError(f"{what} has {', '.join(sorted(map(str, unknown)))}; there is {', '.join(sorted(known))}")
    return content


def _text(content: Any) -> str:
    """A text as it is; TypeError for what YAML takes for something else, such as on and 1.0."""
    if not isinstance(content, str):
        raise TypeError(f"{content!r} is no text; put it into quotes")
    return content


def _run(name: str, content: Any) -> ClaimRun:
    given = _mapping(content, {"recipe", "overrides", "minutes"}, f"the run '{name}'")
    overrides = tuple(map(_text, given.get("overrides", ())))
    return ClaimRun(_text(name), _text(given["recipe"]), overrides, float(given.get("minutes", 1.0)))


def _claim(content: Any) -> Claim:
    given = _mapping(content, CLAIM_KEYS, f"the claim '{content.get('id')}'")
    expect = Expectation.parsed(given["expect"]) if "expect" in given else None
    protocol, variant = (_measurement(given.get(key), expect) for key in ("protocol", "variant"))
    why_not = given.get("not_reproduced", "")
    if (protocol is None) == (not why_not):
        raise ValueError(f"the claim '{given['id']}' needs either a protocol, or not_reproduced with the reason")
    return Claim(
        id=_text(given["id"]),
        place=_text(given["place"]),
        says=_text(given["says"]),
        reported=_text(given["reported"]),
        expect=expect,
        protocol=protocol,
        variant=variant,
        not_reproduced=why_not,
        note=given.get("note", ""),
    )


def _measurement(content: Any, expect: Expectation | None) -> Measurement | None:
    """Of {run, metric}, or {run, metrics}; a metric may say a run of its own."""
    if content is None:
        return None
    given = _mapping(content, {"run", "metric", "metrics"}, "a protocol")
    if expect is None:
        raise ValueError("a claim that is measured needs `expect`")
    named: Mapping[str, Any] = given["metrics"] if "metrics" in given else {"": given["metric"]}
    if (len(named) > 1) != (expect.order != ""):
        raise ValueError("an order is between several metrics, anything else about one")
    return Measurement({str(name): _quantity(metric, given.get("run", "")) for name, metric in named.items()})


def _quantity(content: Any, run: str) -> Quantity:
    if isinstance(content, dict):
        given = _mapping(content, {"run", "metric"}, "a metric")
        return parsed_quantity(_text(given["metric"]), _text(given.get("run", run)))
    return parsed_quantity(_text(content), _text(run))
