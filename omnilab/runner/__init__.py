"""The runner: finds plugins, composes and builds a configuration, executes it, and keeps the run's folder."""
