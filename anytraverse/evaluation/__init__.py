"""Scores perceivers on labelled drives."""
