"""`omnilab check`: what a folder of images shows, before a study believes it."""
