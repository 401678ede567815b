"""The index of runs and sweeps: a cache of what their folders say."""
