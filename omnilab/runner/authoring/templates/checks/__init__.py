"""The tests that come with a component of each kind."""
