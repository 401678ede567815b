"""Modules that several studies share: describing, methods under comparison, scores, tables, plots."""
