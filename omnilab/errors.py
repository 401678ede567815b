"""What can go wrong by no fault of ours. The command line shows these as one sentence and ends with exit code 2."""


class OmnilabError(Exception):
    """A mistake of the user, the data or the machine, told in one sentence that ends with what fixes it."""


class ConfigError(OmnilabError):
    """A value in the configuration cannot be used."""


class DataError(OmnilabError):
    """Images, positions, worlds or logs are not as expected."""


class PluginError(OmnilabError):
    """A plugin does not keep the contract."""
