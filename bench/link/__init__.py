"""The radio link under a bad radio, under rubbish and under load: `python -m bench.link`."""
