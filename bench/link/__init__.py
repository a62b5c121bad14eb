"""Tests the radio link over a bad radio, with mutated frames and under load: `python -m bench.link`."""
