"""Settings that are URLs: the configuration with local paths in their place."""

from __future__ import annotations

import copy

from omegaconf import DictConfig, OmegaConf

from omnilab.errors import ConfigError
from omnilab.runner.config import cache_folder, literal, structured
from omnilab.runner.input_files import leaves
from omnilab.runner.storage.urls import check, is_url, local_path, protocol_of

FOLDER = "fetched"  # within the cache


def urls_of(config: DictConfig) -> dict[str, str]:
    """The settings that name an input by its URL; a live sensor's address is none, nor is what a sink sends to."""
    others = [
        "sinks.",
        *(path for path, node in structured(config) if getattr(OmegaConf.get_type(node), "live", False)),
    ]
    return {name: url for name, url in leaves("", config) if is_url(url) and not name.startswith(tuple(others))}


def with_local_inputs(config: DictConfig) -> tuple[DictConfig, dict[str, str]]:
    """A configuration with the paths of local copies in place of URLs; and the URLs, by setting.

    ConfigError and DataError, in sentences, for those that are not taken, or cannot be fetched.
    """
    urls = urls_of(config)
    if not urls:
        return config, urls
    local = copy.deepcopy(config)
    for name, url in urls.items():
        check(name, url)
        path = local_path(url) if protocol_of(url) == "file" else _fetched(name, url, config)
        OmegaConf.update(local, name, literal(path))
    return local, urls


def _fetched(name: str, url: str, config: DictConfig) -> str:
    folder = cache_folder(config.logs, config.cache)
    if folder is None:
        raise ConfigError(f"{name}={url} is fetched into the cache, and cache=off; give cache=DIR, or a local path")
    try:
        from omnilab.runner.storage.fetching import Limits, fetched
    except ImportError as error:
        raise ConfigError(
            f"{name}={url} is read with {error.name}, which is not installed: pip install 'omnilab[storage]'"
        ) from error
    return str(fetched(name, url, folder.absolute() / FOLDER, Limits(config.cache_gb, config.limits)))
