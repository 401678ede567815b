"""The command line. `omnilab plugins | runs | view | repeat | repair` are ours, everything else is Hydra's."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from omnilab.errors import ConfigError, DataError, OmnilabError
from omnilab.logbook import find_runs, load_run, new_folder_name
from omnilab.registry import Registry, discover


def main(argv: Sequence[str] | None = None) -> None:
    """Run a command; a user's mistake is one line and exit code 2, a bug is a traceback."""
    argv = list(sys.argv[1:] if argv is None else argv)
    command = COMMANDS.get(argv[0]) if argv else None
    try:
        code = command(argv[1:]) if command else experiment(argv)
    except OmnilabError as error:
        print_error(str(error))
        code = 2
    except KeyboardInterrupt:
        print_error("interrupted; the logs are complete up to here")
        code = 130
    sys.exit(code)


def print_error(sentence: str) -> None:
    """One line on standard error."""
    sys.stderr.write(f"omnilab: {sentence}\n")


# ------------------------------------------------------------------------------------------------------ experiments
def experiment(argv: list[str]) -> int:
    """Compose the configuration with Hydra and run it, once or as a sweep."""
    import hydra
    from hydra.errors import HydraException
    from omegaconf import DictConfig, OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    registry = _discover_loudly()
    OmegaConf.register_new_resolver("omnilab_folder", new_folder_name, use_cache=True, replace=True)

    def task(config: DictConfig) -> None:
        run_composed(config, registry)

    task.__module__ = __name__
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions come to us instead of being printed by Hydra
    sys.argv = [sys.argv[0], *argv]
    try:
        hydra.main(version_base="1.3", config_path="pkg://omnilab.conf", config_name="config")(task)()
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(hydra_sentence(error, registry)) from error
    return 0


def _discover_loudly() -> Registry:
    registry = discover()
    for failure in registry.failures:
        print_error(f"{failure.sentence} (omnilab plugins -v shows the traceback)")
    return registry


def run_composed(config: Any, registry: Registry) -> None:
    """One job: build, execute, show what came out."""
    from hydra.core.hydra_config import HydraConfig

    from omnilab.run import build, execute

    hydra_config = HydraConfig.get()
    folder = Path(hydra_config.runtime.output_dir)
    overrides = list(hydra_config.overrides.task)
    if hydra_config.mode is not None and hydra_config.mode.name == "MULTIRUN":
        print_error(f"job {hydra_config.job.num}: {' '.join(overrides)}")
    run = build(config, registry)
    execute(run, folder, registry, overrides, str(hydra_config.runtime.choices.get("experiment")))
    show_run(folder)


def hydra_sentence(error: Exception, registry: Registry) -> str:
    """What Hydra and OmegaConf say, as one sentence with a suggestion."""
    text = str(error)
    if found := re.search(r"Could not find '(\w+)/([^']+)'", text):
        kind, name = found.groups()
        if registry.names(kind):
            return registry.missing(kind, name)
    if found := re.search(r"Could not override '(\w+)@?", text):
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        return " ".join(lines)
    cause = error.__cause__ if isinstance(error.__cause__, Exception) else None
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if cause is not None and str(cause).splitlines():
        lines.append(str(cause).splitlines()[0].strip())
    return "; ".join(dict.fromkeys(lines))


class Summary:
    """A Hydra callback: the table over all jobs of a sweep."""

    def on_multirun_end(self, config: Any, **_: Any) -> None:
        from omnilab.logbook import write_summary

        folder = Path(config.hydra.sweep.dir)
        header, rows = write_summary(folder)
        _print_table(header, rows, title=f"{folder}/summary.csv")

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name.startswith("on_"):  # Hydra calls every event on every callback
            return lambda *_, **__: None
        raise AttributeError(name)


def show_run(folder: Path) -> None:
    """The metrics of a finished run."""
    run = load_run(folder)
    rows = [[name, f"{value:.6g}", run.units[name].replace("1", "", 1)] for name, value in run.metrics.items()]
    _print_table(["metric", "value", "unit"], rows, title=str(_short(folder)))


def _print_table(header: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(*header, title=title or None, box=box.SIMPLE_HEAD, title_justify="left", title_style="bold")
    for row in rows:
        table.add_row(*row)
    Console(soft_wrap=False).print(table)


def _short(path: Path) -> Path:
    """Relative to where we are, if it lies below."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


# ------------------------------------------------------------------------------------------------------ commands
def plugins(argv: list[str]) -> int:
    """List every component there is; failures last."""
    parser = argparse.ArgumentParser("omnilab plugins", description=plugins.__doc__)
    parser.add_argument("-v", "--verbose", action="store_true", help="show the tracebacks of plugins that failed")
    options = parser.parse_args(argv)
    registry = discover()
    rows = [
        [
            c.kind,
            c.name,
            f"{c.cls.__module__}.{c.cls.__qualname__}",
            f"{c.plugin.distribution} {c.plugin.version}",
            c.summary,
        ]
        for c in sorted(registry.components.values(), key=lambda c: (c.kind, c.name))
    ]
    _print_table(["kind", "name", "class", "distribution", "what it is"], rows)
    for failure in registry.failures:
        print_error(failure.sentence)
        if options.verbose:
            sys.stderr.write(failure.traceback)
    return 1 if registry.failures else 0


def runs(argv: list[str]) -> int:
    """List the runs there are, with their status and main metrics."""
    parser = argparse.ArgumentParser("omnilab runs", description=runs.__doc__)
    parser.add_argument("logs", nargs="?", type=Path, default=Path("logs"), help="where to look (default: logs)")
    options = parser.parse_args(argv)
    rows = []
    for run in find_runs(options.logs):
        main_metrics = [f"{name} {value:.4g}" for name, value in list(run.metrics.items())[:3]]
        overrides = [o for o in run.manifest["overrides"] if not o.startswith("experiment=")]
        rows.append(
            [str(run.folder.relative_to(options.logs)), run.state, ", ".join(main_metrics), " ".join(overrides)]
        )
    _print_table(["run", "status", "main metrics", "overrides"], rows)
    return 0


def view(argv: list[str]) -> int:
    """Open a run's recording in Rerun, or take its picture without a display."""
    parser = argparse.ArgumentParser("omnilab view", description=view.__doc__)
    parser.add_argument(
        "run", nargs="?", type=Path, default=Path("logs/latest"), help="run folder (default: the latest)"
    )
    parser.add_argument("--screenshot", type=Path, metavar="FILE", help="write a PNG instead of opening a window")
    parser.add_argument("--step", type=int, help="the step to show in the picture (default: the last with an image)")
    options = parser.parse_args(argv)
    registry = _discover_loudly()
    run = load_run(options.run)
    _repair(run.folder, registry)
    viewer = registry.get("sink", "rerun").cls()
    viewer.view(run.folder, screenshot=options.screenshot, step=options.step)
    return 0


def repeat(argv: list[str]) -> int:
    """Run a run's configuration and seed again, and say whether the metrics are the same (exit code 1 if not)."""
    parser = argparse.ArgumentParser("omnilab repeat", description=repeat.__doc__)
    parser.add_argument(
        "run", nargs="?", type=Path, default=Path("logs/latest"), help="run folder (default: the latest)"
    )
    options = parser.parse_args(argv)
    import yaml

    from omnilab.run import again, execute

    registry = _discover_loudly()
    first = load_run(options.run)
    saved = yaml.safe_load((first.folder / "config.yaml").read_text(encoding="utf-8"))
    run = again(saved, first.manifest, registry)
    name = str(first.manifest["experiment"])
    folder = Path(run.logs) / name / new_folder_name()
    execute(run, folder, registry, first.manifest["overrides"], name)
    show_run(folder)
    second = load_run(folder)
    if not first.metrics:
        raise DataError(f"{options.run} did not finish ({first.state}), so there is nothing to compare with")
    different = [
        n for n in {**first.metrics, **second.metrics} if repr(first.metrics.get(n)) != repr(second.metrics.get(n))
    ]
    if different:
        print_error(f"the metrics differ from {_short(first.folder)}: {', '.join(different)}")
        return 1
    print_error(f"the metrics are the same as in {_short(first.folder)}, bit for bit")
    return 0


def repair(argv: list[str]) -> int:
    """Mend the logs of a run that was killed."""
    parser = argparse.ArgumentParser("omnilab repair", description=repair.__doc__)
    parser.add_argument(
        "run", nargs="?", type=Path, default=Path("logs/latest"), help="run folder (default: the latest)"
    )
    options = parser.parse_args(argv)
    run = load_run(options.run)
    done = _repair(run.folder, _discover_loudly())
    if not done:
        print_error(f"{_short(run.folder)} is whole, nothing to repair")
    return 0


def _repair(folder: Path, registry: Registry) -> list[str]:
    done = [s for name in registry.names("sink") if (s := registry.get("sink", name).cls().repair(folder))]
    for sentence in done:
        print_error(sentence)
    return done


COMMANDS: dict[str, Callable[[list[str]], int]] = {
    "plugins": plugins,
    "runs": runs,
    "view": view,
    "repeat": repeat,
    "repair": repair,
}
