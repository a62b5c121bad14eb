"""Reads and checks config/companion.toml and a vehicle's file, as frozen dataclasses."""

from __future__ import annotations

from companion.config.printing import format_config, json_schema
from companion.config.reading import load_config, recorded_config, state_folder, word_problem
from companion.config.schema import Config
from companion.config.toml_file import ConfigError, Problem

__all__ = [
    "Config",
    "ConfigError",
    "Problem",
    "format_config",
    "json_schema",
    "load_config",
    "recorded_config",
    "state_folder",
    "word_problem",
]
