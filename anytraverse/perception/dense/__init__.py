"""Perceives with a model whose patches and texts share one space: a word costs one product a patch."""
