"""What `omnilab new` makes components of: a module of each kind, the tests of each, and the files of a distribution."""
