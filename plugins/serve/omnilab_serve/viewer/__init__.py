"""The Rerun viewer of the installed version, and the recordings that it is shown."""
