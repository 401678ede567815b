"""Settings on the command line: before Hydra reads them, and what was wrong with them."""
